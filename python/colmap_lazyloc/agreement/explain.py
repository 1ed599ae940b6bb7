"""Do poses fit the photos, and if not, what are they?

`explain` compares the given poses with matched pairs of images. Then it reads the same numbers in the other ways that
`readings` lists; the first of these by which the pairs agree explains what is wrong.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from colmap_lazyloc.agreement.pairs import MatchedPair
from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px, medians_by_pair
from colmap_lazyloc.agreement.readings import Reading, all_readings, other_focal_length, turned_world
from colmap_lazyloc.agreement.relative import RelativePoses
from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.pose_formats.conventions import Convention

AGREEING_PX = 4.0  # at most, the median error of the matches of a pair that agrees
MIN_NUM_PAIRS = 6  # fewer say nothing
CLEARLY = 2.0  # the factor between errors that counts
MOVED_PX, MOVED_DEG = 2.0, 3.0  # errors of a pair below these need no explanation
EXACT_PX = 0.6  # error of a pair below which its matches fit the poses
MIN_MENDED_SHARE = 0.6  # of the pairs that disagree, which a reading must mend
MIN_MENDED_OF_ALL = 0.15  # of all pairs
MIN_NUM_MENDED = 5
MAX_SPOILT_SHARE = 0.1  # of all pairs
MIN_IMPROVED_SHARE, MIN_IMPROVEMENT = 0.7, 0.35  # of pairs, and of the mean log error, by a number that was fitted
MAX_TURN_DEG = 3.0  # readings whose rotations are worse than the best ones by this are not looked at further
NUM_QUICK_MATCHES = 12  # of a pair, for the first comparison of readings
NUM_CANDIDATES = 40  # readings that are compared by all matches
FOCAL_STEPS = (1.2, 1.04, 1.008)  # of factors of the focal length, coarse to fine: from 1/4 to 4
NUM_FOCAL_CANDIDATES = 5  # readings that are tried with other focal lengths, too
FOCAL_FACTORS = (0.25, 0.35, 0.5, 0.7, 0.85, 1.2, 1.4, 2.0, 2.8, 4.0)  # that are tried by rotations alone
NUM_FOCAL_PAIRS = 20
MIN_FOCAL_ROTATION_DEG = 1.5  # errors of the rotations that another focal length may explain, at least
MAX_FOCAL_ROTATION_DEG = 5.0  # errors of the rotations that these leave, at most
MAX_NUM_STEPS = 15  # of the refinement of a turn
MAX_DIRECTION_DEG = 45.0  # error of the relative positions above which poses are of no use
MAX_ROTATION_DEG = 10.0  # error of the relative rotations above which they are, with one of the next two
MAX_DIRECTION_BESIDE_DEG = 20.0  # of the relative positions
MAX_UPPER_ROTATION_DEG = 60.0  # of a quarter of the pairs


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """How far each pair is from fitting poses: the median of its matches in pixels, and its relative rotation in
    degrees. NaN where an image has no pose, or the matches determine no rotation or were not asked for one."""

    px: Floats
    rotation_deg: Floats

    @property
    def num_agreeing(self) -> int:
        return int(np.count_nonzero(self.px <= AGREEING_PX))

    @property
    def disagrees(self) -> Array:
        """Which pairs are far enough off to need an explanation, by their matches or their rotations."""
        return (self.px > MOVED_PX) | (self.rotation_deg > MOVED_DEG)

    @property
    def needs_explanation(self) -> bool:
        """True if there is something that a reading could mend. Rotations of pairs whose matches fit to a fraction of a
        pixel are not known better than the poses give them."""
        is_turned = (self.rotation_deg > MOVED_DEG) & (self.px > EXACT_PX)
        num_off = np.count_nonzero((self.px > MOVED_PX) | is_turned)
        return bool(num_off >= MIN_NUM_MENDED or np.median(self.px) > MOVED_PX)

    @property
    def agrees(self) -> bool:
        """True if half of the pairs that have poses agree."""
        return 2 * self.num_agreeing >= np.count_nonzero(np.isfinite(self.px)) > 0

    @property
    def score(self) -> float:
        """The mean log error of the pairs that have poses; infinite if fewer than half do."""
        known = self.px[np.isfinite(self.px)]
        if 2 * len(known) < len(self.px):
            return np.inf
        return round(float(np.mean(np.log(np.clip(known, 0.5, 1000)))), 2)  # smaller differences mean nothing


@dataclasses.dataclass(frozen=True, eq=False)
class Explanation:
    """What pairs say about poses.

    `given`: how the poses fit as they were given. `reading`: what they are instead, and `mended`: how they fit so; None
    if they are what they are said to be, or nobody knows. `is_hopeless`: they are as far off as poses of other photos.
    `position_error`: of the relative poses in the median, in the unit of the poses; NaN if unknown.
    """

    pairs: Sequence[MatchedPair]
    given: Fit
    reading: Reading | None
    mended: Fit | None
    is_hopeless: bool
    position_error: float


@dataclasses.dataclass(frozen=True, eq=False)
class _Evidence:
    """Pairs, and the poses to compare with them; `used`: indices of the images of pairs."""

    matches: Matches
    relative: RelativePoses
    poses: Poses
    used: Array

    def fit(self, variants: Sequence[Poses]) -> Fit:
        """Compares poses; of several variants, each pair takes those that fit it best."""
        combinations = [(first, second) for first in variants for second in variants]
        px = [_errors(self.matches, *both) for both in combinations]
        return Fit(np.min(px, axis=0), self.rotation_errors_deg(variants))

    def rotation_errors_deg(self, variants: Sequence[Poses]) -> Floats:
        errors = [self.relative.rotation_errors_deg(first, second) for first in variants for second in variants]
        smallest: Floats = np.min(errors, axis=0)
        return smallest

    def read(self, reading: Reading) -> Sequence[Poses]:
        return reading.apply(self.poses, self.used)

    def settle(self, reading: Reading) -> tuple[Sequence[Poses], Array]:
        """Returns the poses by a reading, and which pairs it changes. Where each image may have one of two poses, it
        has the one that its matches fit better."""
        variants = self.read(reading)
        if not reading.is_of_some:
            return variants, np.ones(len(self.matches.pairs), bool)
        first, second = variants
        is_second = np.zeros(len(first.centres), bool)
        is_second[reading.images_of(self.matches, variants, self.used)] = True
        rotations = np.where(is_second[:, None, None], second.rotations, first.rotations)
        chosen = Poses(rotations, np.where(is_second[:, None], second.centres, first.centres))
        return [chosen], is_second[self.matches.first] | is_second[self.matches.second]

    def quick(self) -> "_Evidence":
        """Returns the same with fewer matches."""
        return dataclasses.replace(self, matches=Matches.of(self.matches.pairs, NUM_QUICK_MATCHES))


def _errors(matches: Matches, first: Poses, second: Poses) -> Floats:
    """Returns the median error of each pair in pixels."""
    return medians_by_pair(matches, errors_px(matches, first, second))


def explain(
    pairs: Sequence[MatchedPair], names: Sequence[str], poses: Poses, convention: Convention
) -> Explanation | None:
    """Compares poses of images by name with matched pairs of these; None if there are too few pairs."""
    if len(pairs) < MIN_NUM_PAIRS:
        return None
    used, places = np.unique([(pair.first, pair.second) for pair in pairs], return_inverse=True)
    local = [
        dataclasses.replace(pair, first=int(first), second=int(second))
        for pair, (first, second) in zip(pairs, places.reshape(-1, 2))
    ]
    matches, own = Matches.of(local), poses.take(used)
    # Estimating relative poses takes time, and those of pairs whose matches fit the given poses mean nothing.
    evidence = _Evidence(matches, RelativePoses.of(local, _errors(matches, own, own) > EXACT_PX), poses, used)
    given = evidence.fit([own])
    if given.needs_explanation or not given.agrees:
        evidence = dataclasses.replace(evidence, relative=RelativePoses.of(local))
        given = evidence.fit([own])
    reading, mended = None, None
    if given.needs_explanation:
        reading, mended = _find_reading(evidence, given, all_readings(names, convention))
    if reading is None and not given.agrees:
        reading, mended = _find_focal_length(evidence, own, given)
    is_hopeless = reading is None and _is_hopeless(evidence, [own], given)
    return Explanation(pairs, given, reading, mended, is_hopeless, evidence.relative.position_error(own))


def _find_reading(evidence: _Evidence, given: Fit, readings: Sequence[Reading]) -> tuple[Reading | None, Fit | None]:
    """Returns the reading that explains the pairs and how it fits them, if there is one."""
    turned = np.array([np.nanmedian(evidence.rotation_errors_deg(evidence.read(reading))) for reading in readings])
    likely = [readings[index] for index in np.flatnonzero(turned <= CLEARLY * turned.min() + MAX_TURN_DEG)]
    quick = evidence.quick()
    likely = sorted(likely, key=lambda reading: quick.fit(quick.read(reading)).score + reading.rarity)[:NUM_CANDIDATES]
    # Two poses for each image fit anything a little better, and nobody has these with other focal lengths, too.
    of_all = [reading for reading in likely if not reading.is_of_some]
    likely += _fitted_readings(quick, of_all[:NUM_FOCAL_CANDIDATES])
    settled = [evidence.settle(reading) for reading in likely]
    fits = [evidence.fit(variants) for variants, _ in settled]
    for index in np.argsort([fit.score + reading.rarity for fit, reading in zip(fits, likely)], kind="stable"):
        reading, fit, (variants, is_changed) = likely[index], fits[index], settled[index]
        # A number that was fitted to the pairs must make them agree, because it mends errors of any kind a little.
        mends = _mends(fit, given, is_changed)
        if reading.is_fitted:
            mends = fit.agrees and (mends or _improves(fit, given))
        if mends and not _is_hopeless(evidence, variants, fit):
            return reading, fit
    return None, None


def _find_focal_length(evidence: _Evidence, poses: Poses, given: Fit) -> tuple[Reading | None, Fit | None]:
    """Returns the reading with another focal length for which the matches give the rotations of the poses, if there is
    one. Inexact positions do not matter for rotations."""

    def rotations_by(factor: float, pairs: Sequence[MatchedPair]) -> Floats:
        relative = RelativePoses.of([pair.with_focal_factor(factor) for pair in pairs])
        return relative.rotation_errors_deg(poses, poses)

    some = evidence.matches.pairs[:NUM_FOCAL_PAIRS]
    factor = min(FOCAL_FACTORS, key=lambda value: float(np.nanmedian(rotations_by(value, some))))
    rotation_deg = rotations_by(factor, evidence.matches.pairs)
    before, after = float(np.nanmedian(given.rotation_deg)), float(np.nanmedian(rotation_deg))
    if before < MIN_FOCAL_ROTATION_DEG or after * CLEARLY > before or after > MAX_FOCAL_ROTATION_DEG:
        return None, None
    reading = other_focal_length(Reading("", ""), factor)
    return reading, Fit(evidence.fit(reading.transform(poses)).px, rotation_deg)


def _fitted_readings(evidence: _Evidence, readings: Sequence[Reading]) -> Iterator[Reading]:
    """Yields the readings with a number that the pairs determine: a turn of the world for the given poses, and a factor
    of the focal length for these and for other readings."""
    own = evidence.poses.take(evidence.used)
    turn = evidence.relative.turn_of_world(own)
    if turn is not None:
        yield turned_world(_refine_turn(evidence.matches, own, turn))
    for reading in [Reading("", ""), *readings]:
        variants, factor = evidence.read(reading), 1.0
        for step in FOCAL_STEPS:
            factors = factor * step ** np.arange(-8, 9)
            scores = [
                evidence.fit([dataclasses.replace(poses, focal_factor=value) for poses in variants]).score
                for value in factors.tolist()
            ]
            factor = float(factors[np.argmin(scores)])
        yield other_focal_length(reading, factor)


def _refine_turn(matches: Matches, poses: Poses, turn: Floats) -> Floats:
    """Returns the turn of the world that fits the matches best, from one that fits the directions of pairs."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    def turned(vector: Floats) -> Floats:
        return np.asarray(Rotation.from_rotvec(vector).as_matrix()) @ turn

    def residuals(vector: Floats) -> Floats:
        (each,) = turned_world(turned(vector)).transform(poses)
        return errors_px(matches, each, each)

    return turned(least_squares(residuals, np.zeros(3), loss="soft_l1", max_nfev=MAX_NUM_STEPS).x)


def _mends(fit: Fit, given: Fit, is_changed: Array) -> bool:
    """True if a reading mends most of the pairs that disagree and that it changes, by their matches or their rotations,
    and spoils hardly any."""
    known = np.isfinite(fit.px)
    mended, spoilt = np.zeros((2, len(known)), bool)
    for new, old, small in ((fit.px, given.px, MOVED_PX), (fit.rotation_deg, given.rotation_deg, MOVED_DEG)):
        mended |= known & (old > small) & (new * CLEARLY < old)
        spoilt |= known & (new > small * CLEARLY) & (new > old * CLEARLY)
    num_mended, num_known = np.count_nonzero(mended & ~spoilt), np.count_nonzero(known)
    return bool(
        num_mended >= MIN_MENDED_SHARE * np.count_nonzero(known & given.disagrees & is_changed)
        and num_mended >= max(MIN_NUM_MENDED, MIN_MENDED_OF_ALL * num_known)
        and np.count_nonzero(spoilt) <= MAX_SPOILT_SHARE * num_known
    )


def _improves(fit: Fit, given: Fit) -> bool:
    """True if a fitted number makes the errors of most pairs smaller, even if these are small."""
    is_better = float(np.mean(fit.px < given.px)) >= MIN_IMPROVED_SHARE
    return is_better and given.score - fit.score >= MIN_IMPROVEMENT and float(np.median(given.px)) > MOVED_PX


def _is_hopeless(evidence: _Evidence, variants: Sequence[Poses], fit: Fit) -> bool:
    """True if the poses are as far off as those of other photos would be."""
    if fit.agrees:
        return False
    is_turned = bool(np.nanmedian(fit.rotation_deg) > MAX_ROTATION_DEG)
    # Rotations of a drone without a gimbal may be off by 20 degrees, but those of some photos by more if all are wrong.
    if is_turned and np.nanpercentile(fit.rotation_deg, 75) > MAX_UPPER_ROTATION_DEG:
        return True
    combinations = [(first, second) for first in variants for second in variants]
    directions = np.min([evidence.relative.direction_errors_deg(*both) for both in combinations], axis=0)
    # Of near images, even the direction between right positions is not known.
    lengths = evidence.relative.lengths(*combinations[0])
    is_far = np.isfinite(directions) & (lengths >= np.nanmedian(lengths))
    if not is_far.any():
        return is_turned
    return bool(np.median(directions[is_far]) > (MAX_DIRECTION_BESIDE_DEG if is_turned else MAX_DIRECTION_DEG))

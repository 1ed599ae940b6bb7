"""Says whether poses agree with photos, in one line, and stops what would go on with wrong ones."""

import dataclasses
import logging
import pathlib
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from colmap_lazyloc.agreement.contradictions import contradicted_images
from colmap_lazyloc.agreement.explain import AGREEING_PX, MAX_ROTATION_DEG, MOVED_PX, Explanation, explain
from colmap_lazyloc.agreement.own_cameras import own_cameras
from colmap_lazyloc.agreement.pairs import MAX_NUM_PAIRS, MatchedPair, pairs_of_database
from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px, medians_by_pair
from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.errors import InputError, first_names, logger
from colmap_lazyloc.extras import install_command, is_installed
from colmap_lazyloc.pose_formats.conventions import COLMAP, Convention
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages
from colmap_lazyloc.progress import ProgressBar

MAX_NUM_NAMED = 10  # images that contradict the others
MAX_NUM_TURNED = 3  # images that are named as turned, or as not compared, and pairs that do not agree
PAIRS_OF_AN_IMAGE = 3  # that are looked at, to name images whose poses are wrong
MAX_NUM_IMAGE_PAIRS = 3000
NEEDED = ("cv2", "scipy")


def add_accept_option(add: Callable[..., Any]) -> None:
    """Adds the option that switches the check off; `add`: the function of an argument parser."""
    add("--accept_poses", action="store_true", help="continue even if the photos contradict the poses; default: stop")


@dataclasses.dataclass(frozen=True)
class Judgement:
    """What photos show about poses: in a line, whether the poses are not what they are said to be, the options of
    `lazyloc import` that mend them (empty if there are none), the names of images whose poses contradict those of the
    others, and what makes the poses inexact (empty if nothing is known to)."""

    line: str
    is_wrong: bool
    options: str
    contradicted: list[str]
    advice: str

    def lines(self) -> list[str]:
        """Returns the line, one that names images, if there are any, and the advice."""
        names = first_names(self.contradicted, MAX_NUM_NAMED)
        named = f"but these contradict the others, by their poses or by wrong matches: {names}"
        return [self.line, *([named] if names else []), *filter(None, [self.advice])]


def check_photos(
    posed: PosedImages, folder: pathlib.Path, label: str, accepts: bool, masks: pathlib.Path | None = None
) -> None:
    """Compares poses with the photos below a folder; raises InputError that begins with the label if they are wrong.

    `masks`: folder of masks, NAME.png for the photo NAME.
    """
    missing = [module for module in NEEDED if not is_installed(module)]
    if missing:
        logger.warning("the poses are not compared with the photos: %s", install_command("import", missing))
        return
    from colmap_lazyloc.agreement.photo_pairs import pairs_of_photos

    with ProgressBar("", what="comparing the poses with the photos"):
        pairs = pairs_of_photos(folder, posed.images, masks)
        found = judge(pairs, posed.images, posed.convention, posed.origin is not None)
    if found is None:
        logger.info(
            "the poses cannot be compared with the photos: %s",
            f"only {len(pairs)} pairs match" if pairs else "none match",
        )
    elif found.is_wrong and not accepts:
        raise InputError(f"{label}: {found.line}, or --accept_poses to go on all the same")
    else:
        for text in found.lines():
            logger.log(logging.WARNING if found.is_wrong or text != found.line else logging.INFO, text)


def judge_database(database: DatabaseReader, images: Sequence[PosedImage], is_metric: bool) -> Judgement | None:
    """Compares poses with the matches of a database; None if too few pairs are matched. `is_metric`: in metres."""
    count = min(MAX_NUM_IMAGE_PAIRS, max(MAX_NUM_PAIRS, PAIRS_OF_AN_IMAGE * len(images)))
    return judge(pairs_of_database(database, images, count), images, COLMAP, is_metric)


def judge(
    pairs: Sequence[MatchedPair], images: Sequence[PosedImage], convention: Convention, is_metric: bool
) -> Judgement | None:
    """Compares the poses of images with pairs of these; the first of them must be the best to look at."""
    poses = Poses.of(images)
    explanation = explain(pairs[:MAX_NUM_PAIRS], [image.name for image in images], poses, convention)
    if explanation is None:
        return None
    is_wrong = explanation.reading is not None or explanation.is_hopeless
    contradicted: list[int] = []
    px: Floats = np.zeros(0)
    turned = ""
    matches = Matches.of(pairs)
    if explanation.reading is not None and explanation.reading.is_of_some:
        every = np.arange(len(images))
        chosen = explanation.reading.images_of(matches, explanation.reading.apply(poses, every), every)
        num_compared = len(np.unique([matches.first, matches.second]))
        names = first_names([images[index].name for index in chosen], MAX_NUM_TURNED)
        turned = f"{len(chosen)} of {num_compared}: {names}"
    if not is_wrong:
        px = medians_by_pair(matches, errors_px(matches, poses, poses))
        contradicted = contradicted_images([(pair.first, pair.second) for pair in pairs], px)
    line = describe(explanation, "m" if is_metric else "units", turned)
    if explanation.given.agrees and not is_wrong:
        line += _unexplained(pairs, images, px, contradicted)
    unmatched = sorted(set(range(len(images))).difference(matches.first.tolist(), matches.second.tolist()))
    if unmatched and not is_wrong:
        line += f"; not compared: {first_names([images[index].name for index in unmatched], MAX_NUM_TURNED)}"
    remedy = "" if explanation.reading is None else explanation.reading.remedy
    options = remedy.removeprefix("give ")
    options = options if re.fullmatch(r"(--\w+ \w+ ?)+", options) else ""
    advice = "" if is_wrong else own_cameras(images)
    return Judgement(line, is_wrong, options, [images[index].name for index in contradicted], advice)


def _unexplained(
    pairs: Sequence[MatchedPair], images: Sequence[PosedImage], px: Floats, contradicted: Sequence[int]
) -> str:
    """Returns what the line says of pairs that do not agree although neither of their images contradicts the others."""
    others = [pair for pair, error in zip(pairs, px) if error > AGREEING_PX]
    others = [pair for pair in others if {pair.first, pair.second}.isdisjoint(contradicted)]
    names = [f"{images[pair.first].name} with {images[pair.second].name}" for pair in others]
    return f"; these do not fit: {first_names(names, MAX_NUM_TURNED)}" if names else ""


def describe(explanation: Explanation, unit: str, turned: str = "") -> str:
    """Returns one line; `unit`: that of the poses; `turned`: the images that are, if some are."""
    given, reading, mended = explanation.given, explanation.reading, explanation.mended
    agreeing = f"{given.num_agreeing} of {len(given.px)} pairs"
    if reading is not None and mended is not None:
        after = f"{mended.num_agreeing} of {np.count_nonzero(np.isfinite(mended.px))} do"
        if not mended.agrees:
            after = f"they do within {np.nanmedian(mended.rotation_deg):.1f} degrees"
        title = f"{reading.title} ({turned})" if turned else reading.title
        return f"the poses do not fit the photos: {agreeing} agree; as poses {title}, {after}: {reading.remedy}"
    px = float(np.median(given.px))
    if given.agrees and px <= MOVED_PX:
        degrees = np.degrees(px / np.median([pair.focal_px for pair in explanation.pairs]))
        return f"poses agree with the photos: {agreeing}, median {px:.1f} px, {degrees:.2f} degrees"
    turned_deg = float(np.nanmedian(given.rotation_deg))
    errors = f"{turned_deg:.1f} degrees and {explanation.position_error:.2g} {unit} in the median"
    if explanation.is_hopeless:
        return (
            f"the poses do not fit the photos: {agreeing} agree, and relative poses are off by {errors}, as those of "
            "other photos would be: give the poses of these photos"
        )
    is_rough = turned_deg > MAX_ROTATION_DEG
    verdict = (
        "poses agree with the photos only roughly" if is_rough else "poses agree with the photos within their errors"
    )
    return f"{verdict}: {agreeing} within {AGREEING_PX:g} px; relative poses are off by {errors}"

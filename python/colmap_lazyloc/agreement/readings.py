"""What people's files of poses turn out to be: other ways to read the same numbers, each with a name and a remedy.

The first of the readings that fit is taken, so that the more common ones come first.
"""

import dataclasses
import functools
import itertools
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from colmap_lazyloc.agreement.poses import Matches, Poses
from colmap_lazyloc.agreement.turned import images_behind, images_of_second_poses
from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.pose_formats.angles import LEVEL_CAMERA
from colmap_lazyloc.pose_formats.conventions import CAMERA_AXES, DIRECTIONS, Convention
from colmap_lazyloc.pose_formats.naming import natural_order

MAX_SHIFT = 10  # images by which poses are early or late
MAX_SHIFT_OF_SOME = 3  # images by which those behind a missing photo or pose are
MAX_PART_SHIFT = 3  # images, for times that are off by parts of the time between two images
PARTS = 4
PART_RARITY = 0.7
TURN_RARITY = 0.4
FOCAL_RARITY = 0.7
EULER_ORDERS = ("ZYX", "ZXY", "YXZ", "YZX", "XYZ", "XZY")
ORDER_REMEDY = "give poses with names or times, or name the photos so that both have the same order"
ANGLE_REMEDY = "write the angles as docs/own_data.md describes them, or quaternions"
FILE_REMEDY = "mend what wrote the file"

Transform = Callable[[Poses], Sequence[Poses]]


@dataclasses.dataclass(frozen=True, eq=False)
class Reading:
    """A way to read given poses.

    `title` completes "as poses ..."; `remedy`: options of `lazyloc import` and `lazyloc run`, or what to do.
    `source`: which pose each image takes; default: its own. `transform` is applied to each pose; it returns several if
    an image may have any one of them.
    """

    title: str
    remedy: str
    transform: Transform = lambda poses: [poses]
    rarity: float = 0.0
    source: "Source | None" = None
    is_fitted: bool = False  # by a number that was estimated of the pairs
    is_of_some: bool = False  # true if some images have the poses of this reading, and the others the given ones

    def apply(self, poses: Poses, used: Array) -> Sequence[Poses]:
        """Returns the poses of the images with these indices as this reading has them; if it is of some, the given ones
        first."""
        given = poses.take(used)
        read = self.transform(given if self.source is None else self.source.take(poses, used))
        return [given, *read] if self.is_of_some else read

    def images_of(self, matches: Matches, variants: Sequence[Poses], used: Array) -> list[int]:
        """Returns the images, as indices of `used`, that a reading is of which is of some; `variants`: what `apply`
        returns."""
        given, read = variants
        if self.source is None:
            return images_of_second_poses(matches, given, read)
        return images_behind(matches, given, read, self.source.places[used])


@dataclasses.dataclass(frozen=True, eq=False)
class Source:
    """Which pose each image takes: that at its place in an order of the poses. Between two places, poses are
    interpolated; outside of the order there is none."""

    order: Array  # indices of poses
    places: Floats  # for each image

    def take(self, poses: Poses, used: Array) -> Poses:
        from scipy.spatial.transform import Rotation

        places = self.places[used]
        low = np.clip(np.floor(places), 0, len(self.order) - 1).astype(int)
        high = np.clip(np.ceil(places), 0, len(self.order) - 1).astype(int)
        before, after = poses.take(self.order[low]), poses.take(self.order[high])
        weights = (places - low)[:, None]
        turns = Rotation.from_matrix(after.rotations @ _swap(before.rotations)).as_rotvec()
        rotations = np.asarray(Rotation.from_rotvec(weights * turns).as_matrix()) @ before.rotations
        centres = (1 - weights) * before.centres + weights * after.centres
        is_outside = (places < 0) | (places > len(self.order) - 1)
        return Poses(rotations, np.where(is_outside[:, None], np.nan, centres))


def all_readings(names: Sequence[str], convention: Convention) -> list[Reading]:
    """Returns the readings of the poses of images by name, which were read by a convention."""
    families = (
        (0.0, _axes(convention)),
        (0.1, _quaternions(convention)),
        (0.1, _orders(names)),
        (0.2, _vectors(convention)),
        (0.2, _mirrored()),
        (0.3, _worlds()),
        (0.3, _radians()),
        (0.5, _some_turned()),
        (0.5, _some_shifted(names)),
        (1.2, _angles()),
    )
    return [
        dataclasses.replace(reading, rarity=rarity + reading.rarity)
        for rarity, family in families
        for reading in family
    ]


def _signed_permutations() -> list[Floats]:
    """Returns the 24 rotations that turn axes into axes, the identity first."""
    matrices = [
        np.diag(signs)[:, order]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]
    return [matrix for matrix in matrices if np.linalg.det(matrix) > 0]


def _swap(rotations: Floats) -> Floats:
    return np.swapaxes(rotations, 1, 2)


def _times(rotations: Floats, vectors: Floats) -> Floats:
    products: Floats = np.einsum("nij,nj->ni", rotations, vectors)
    return products


def _translations(poses: Poses) -> Floats:
    return -_times(poses.rotations, poses.centres)


def _inverse(poses: Poses) -> Poses:
    return Poses(_swap(poses.rotations), _translations(poses))


def _axes(convention: Convention) -> Iterator[Reading]:
    """Other camera axes, and the other direction with any camera axes."""
    (other,) = (direction for direction in DIRECTIONS if direction != convention.direction)
    for direction in (convention.direction, other):
        is_inverse = direction == other
        invert = _inversion(convention) if is_inverse else None
        # The axes by which inverse poses were read have turned the world.
        read = np.eye(3) if is_inverse else CAMERA_AXES[convention.camera_axes]
        words = [f"--pose_direction {direction}"] if is_inverse else []
        start = f"read as {direction} " if is_inverse else ""
        names = sorted(CAMERA_AXES, key=lambda name: name != convention.camera_axes)
        named = [(name, CAMERA_AXES[name].T @ read) for name in names]
        for name, turn in named:
            options = words + ([] if name == convention.camera_axes else [f"--camera_axes {name}"])
            if options:
                title = start if name == convention.camera_axes else f"{start}with camera axes of {name}"
                yield Reading(title.strip(), "give " + " ".join(options), _with_axes(turn, invert))
        for turn in _signed_permutations():
            if not any(np.allclose(turn, axes) for _, axes in named):
                title, remedy = _name_turn(turn)
                yield Reading(start + title, remedy, _with_axes(turn, invert))


def _inversion(convention: Convention) -> Callable[[Poses], Poses]:
    """Returns what the other direction does to poses that were read by a convention."""
    if not convention.fixes_centre():
        return _inverse  # in a world turned by the camera axes, which no pair sees
    axes = CAMERA_AXES[convention.camera_axes]
    return lambda poses: Poses(_swap(poses.rotations) @ axes.T, poses.centres)


def _with_axes(turn: Floats, invert: Callable[[Poses], Poses] | None) -> Transform:
    """Returns the transform to other camera axes, after that of `invert`."""

    def transform(poses: Poses) -> list[Poses]:
        poses = poses if invert is None else invert(poses)
        return [Poses(turn @ poses.rotations, poses.centres)]

    return transform


def _name_turn(turn: Floats) -> tuple[str, str]:
    """Returns title and remedy of a turn of the camera's axes."""
    if turn[2, 2] == 1:
        degrees = round(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))) % 360
        return (
            f"of photos that are turned by {degrees} degrees, as by EXIF's orientation",
            "give photos that are stored as they are shown, or poses and intrinsics of the photos as they are stored",
        )
    return f"with camera axes {_axes_text(turn.T)}", FILE_REMEDY


def _some_turned() -> Iterator[Reading]:
    """Photos of which some are turned, such as those of a drone's way back."""
    for degrees, (cosine, sine) in ((180, (-1, 0)), (90, (0, 1)), (270, (0, -1))):
        matrix = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]], float)

        def transform(poses: Poses, turn: Floats = matrix) -> list[Poses]:
            return [Poses(turn @ poses.rotations, poses.centres)]

        yield Reading(
            f"of photos of which some are turned by {degrees} degrees, as by EXIF's orientation",
            "turn these photos, or give their poses as they are stored",
            transform,
            is_of_some=True,
        )


def _axes_text(matrix: Floats) -> str:
    """Returns the axes that a signed permutation makes of x, y, z, such as `y, -x, z`."""
    return ", ".join("-" * bool(row.sum() < 0) + "xyz"[int(np.argmax(np.abs(row)))] for row in matrix)


def _quaternions(convention: Convention) -> Iterator[Reading]:
    """Quaternions whose real part is at the other end."""
    from scipy.spatial.transform import Rotation

    axes_of_read = dict.fromkeys((convention.camera_axes, "opencv", "opengl"))
    choices = itertools.product(
        sorted(DIRECTIONS, key=lambda direction: direction != convention.direction),
        sorted(DIRECTIONS, key=lambda direction: direction != convention.direction),
        axes_of_read,
        (1, -1),
    )
    for meant, read, axes, shift in choices:

        def transform(
            poses: Poses, meant: str = meant, read: str = read, axes: str = axes, shift: int = shift
        ) -> list[Poses]:
            turn = CAMERA_AXES[axes]
            rotations, vectors = turn @ poses.rotations, _translations(poses) @ turn.T
            if read == "world_from_cam":
                rotations, vectors = _swap(rotations), poses.centres
            quaternions = np.roll(Rotation.from_matrix(rotations).as_quat(), shift, axis=1)
            rotations = np.asarray(Rotation.from_quat(quaternions).as_matrix())
            if meant == "world_from_cam":
                return [Poses(turn.T @ _swap(rotations), vectors)]
            return [Poses(turn.T @ rotations, -_times(_swap(rotations), vectors))]

        order = "xyzw" if convention.quaternion == "wxyz" else "wxyz"
        is_read = convention.rotation == "quaternion" and (read, axes) == (convention.direction, convention.camera_axes)
        is_of_both = not convention.fixes_centre() or read == meant == "world_from_cam"  # of rotation and vector
        options = f"give --quaternion_order {order}"
        if meant != convention.direction:
            options += f" --pose_direction {meant}"
        title = "with quaternions in the other order" + (f", as {meant}" if meant != read else "")
        yield Reading(title, options if is_read and is_of_both else FILE_REMEDY, transform)
        if read == meant == "cam_from_world":
            remedy = FILE_REMEDY if is_of_both or not is_read else options
            yield Reading(f"{title}, beside positions", remedy, _beside_positions(transform))


def _beside_positions(transform: Transform) -> Transform:
    """Returns the transform of rotations alone, whose positions are right."""
    return lambda poses: [dataclasses.replace(each, centres=poses.centres) for each in transform(poses)]


def _vectors(convention: Convention) -> Iterator[Reading]:
    """Centres for translations, and rotations of the other direction beside right centres."""
    opengl = CAMERA_AXES["opengl"]
    if convention.fixes_centre():
        for turn in (np.eye(3), opengl):
            yield Reading("that are inverse, positions too", FILE_REMEDY, _with_axes(turn, _inverse))
    for turn in (np.eye(3), opengl):

        def centre_is_translation(poses: Poses, turn: Floats = turn) -> list[Poses]:
            return [Poses(poses.rotations, -_times(_swap(poses.rotations), poses.centres @ turn))]

        def translation_is_centre(poses: Poses, turn: Floats = turn) -> list[Poses]:
            return [Poses(poses.rotations, _translations(poses) @ turn.T)]

        yield Reading("whose positions are translations (cam_from_world)", FILE_REMEDY, centre_is_translation)
        yield Reading("whose translations are positions of the camera", FILE_REMEDY, translation_is_centre)
    for turn in (np.eye(3), opengl):

        def inverse_rotations(poses: Poses, turn: Floats = turn) -> list[Poses]:
            return [Poses(turn @ _swap(poses.rotations), poses.centres)]

        def inverse_beside_translations(poses: Poses, turn: Floats = turn) -> list[Poses]:
            rotations = turn @ _swap(poses.rotations)
            return [Poses(rotations, -_times(_swap(rotations), _translations(poses) @ turn.T))]

        for transform in (inverse_rotations, inverse_beside_translations):
            yield Reading("whose rotations are inverse, but not their positions", FILE_REMEDY, transform)


def _orders(names: Sequence[str]) -> Iterator[Reading]:
    """Poses that belong to other photos of the same set; `names`: in the order of the file of poses."""
    count = len(names)
    natural = np.array(natural_order(names), int)
    lexical = np.array(sorted(range(count), key=lambda index: names[index]), int)
    by_numbers = "in the order 1, 2, 10 of numbers, where the photos have 1, 10, 2"
    by_letters = "in the order 1, 10, 2 of letters, where the photos have 1, 2, 10"
    if not np.array_equal(natural, lexical):
        # A photo takes the pose that was read for the photo at its place of the order that was assumed.
        yield Reading(by_letters, ORDER_REMEDY, source=Source(natural, _places(lexical)))
        yield Reading(by_numbers, ORDER_REMEDY, source=Source(lexical, _places(natural)))
    orders = {order.tobytes(): order for order in (natural, lexical, np.arange(count))}.values()
    for order, start in itertools.product(orders, (0, 1)):
        # What sorts numbers without leading zeros as words makes this order of photos that are numbered.
        counted = order[sorted(range(count), key=lambda index: str(index + start))]
        yield Reading(by_letters, ORDER_REMEDY, source=Source(order, _places(counted)))
        yield Reading(by_numbers, ORDER_REMEDY, source=Source(counted, _places(order)))
    shifts = [*range(1, MAX_SHIFT + 1), *(part / PARTS for part in range(1, PARTS * MAX_PART_SHIFT) if part % PARTS)]
    for order in orders:
        places = _places(order)
        yield Reading("in reverse order", ORDER_REMEDY, source=Source(order, count - 1 - places))
        for shift, (sign, word) in itertools.product(shifts, ((1, "later"), (-1, "earlier"))):
            title = f"shifted: each is that of the photo {shift:g} place{'s' * (shift != 1)} {word}"
            rarity = 0.0 if shift == int(shift) else PART_RARITY
            yield Reading(title, ORDER_REMEDY, rarity=rarity, source=Source(order, places - sign * shift))


def _some_shifted(names: Sequence[str]) -> Iterator[Reading]:
    """Poses or photos of which one is missing in between, so that those behind it are shifted."""
    natural = np.array(natural_order(names), int)
    for number, (sign, word) in itertools.product(range(1, MAX_SHIFT_OF_SOME + 1), ((1, "later"), (-1, "earlier"))):
        yield Reading(
            f"of which the last ones are shifted: each is that of the photo {number} place{'s' * (number != 1)} {word}",
            f"a photo or a pose is missing in between: {ORDER_REMEDY}",
            source=Source(natural, _places(natural) - sign * number),
            is_of_some=True,
        )


def _places(order: Array) -> Floats:
    """Returns the place of each index in an order."""
    return np.argsort(order).astype(float)


def _mirrored() -> Iterator[Reading]:
    """A left-handed world, with any camera axes."""
    turns = _signed_permutations()
    for turn in sorted(turns, key=lambda turn: np.count_nonzero(turn - np.diag(np.diag(turn)))):

        def transform(poses: Poses, turn: Floats = turn) -> list[Poses]:
            # Mirroring an axis of the world differs from mirroring all three in a rotation, which no pair sees.
            return [Poses(turn @ poses.rotations, -poses.centres)]

        yield Reading("of a left-handed world (mirrored axes)", "mirror an axis of the world in the file", transform)


def _worlds() -> Iterator[Reading]:
    """Positions with other axes of the world than the rotations."""
    for turn, sign in itertools.product(_signed_permutations(), (1, -1)):
        if not np.array_equal(sign * turn, np.eye(3)):
            title = f"with positions {_axes_text(sign * turn)} beside the same rotations"
            remedy = "give positions and rotations with the same axes of the world"

            def transform(poses: Poses, moved: Floats = sign * turn.T) -> list[Poses]:
                return [Poses(poses.rotations, poses.centres @ moved)]

            yield Reading(title, remedy, transform)


def turned_world(turn: Floats) -> Reading:
    """Positions whose world is turned against that of the rotations; `turn`: from the rotations' world to the
    positions'."""
    from scipy.spatial.transform import Rotation

    vector = np.degrees(Rotation.from_matrix(turn).as_rotvec())
    angle = float(np.linalg.norm(vector))
    axis = ", ".join(f"{value:.2f}" for value in vector / max(angle, np.finfo(float).tiny))
    return Reading(
        f"with rotations turned by {angle:.3g} degrees about ({axis}), as axes of a grid are against north",
        "give positions and rotations in the same reference system",
        lambda poses: [dataclasses.replace(poses, rotations=poses.rotations @ turn.T)],
        rarity=TURN_RARITY,
        is_fitted=True,
    )


def other_focal_length(reading: Reading, factor: float) -> Reading:
    """A reading with focal lengths that are multiplied by a factor."""
    return dataclasses.replace(
        reading,
        rarity=reading.rarity + FOCAL_RARITY,
        is_fitted=True,
        title=f"{reading.title} with focal lengths times {factor:.2g}".strip(),
        remedy=f"{reading.remedy}, and give the intrinsics of these photos (--camera)".removeprefix(", and "),
        transform=lambda poses: [dataclasses.replace(each, focal_factor=factor) for each in reading.transform(poses)],
    )


# How angles turn a camera: from cam_from_world to the rotation that is composed of angles, and back.
_COMPOSED: Sequence[tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]] = (
    (lambda r: _swap(r) @ LEVEL_CAMERA.T, lambda r: _swap(r @ LEVEL_CAMERA)),
    (_swap, _swap),
    (lambda r: r, lambda r: r),
)


def _radians() -> Iterator[Reading]:
    """Angles, or rotation vectors, in radians that were read as degrees."""
    from scipy.spatial.transform import Rotation

    def of_vector(rotation: Rotation) -> list[Rotation]:
        return [Rotation.from_rotvec(np.degrees(rotation.as_rotvec()))]

    def of_angles(rotation: Rotation, order: str) -> list[Rotation]:
        return [Rotation.from_euler(order, np.degrees(rotation.as_euler(order)))]

    turns = [(_COMPOSED[2], of_vector)]
    turns += [
        (composed, functools.partial(of_angles, order=order))
        for composed, order in itertools.product(_COMPOSED, EULER_ORDERS)
    ]
    for composed, turn in turns:
        transform = _of_rotations(composed, turn)
        yield Reading("whose angles are radians, not degrees", "write the angles in degrees", transform)


def _angles() -> Iterator[Reading]:
    """Angles in another order, or with other signs."""
    from scipy.spatial.transform import Rotation

    for composed, read, meant, columns in itertools.product(
        _COMPOSED, EULER_ORDERS, EULER_ORDERS, itertools.permutations(range(3))
    ):
        if read == meant and columns == (0, 1, 2):
            continue
        yield Reading(
            f"whose angles are in another order ({_angles_text(read, meant, columns)})",
            ANGLE_REMEDY,
            _of_rotations(
                composed,
                lambda rotation, read=read, meant=meant, columns=list(columns): [
                    Rotation.from_euler(meant, angles[:, columns]) for angles in _both_angles(rotation.as_euler(read))
                ],
            ),
        )
    for composed, order, signs in itertools.product(_COMPOSED, EULER_ORDERS, itertools.product((1, -1), repeat=3)):
        if signs != (1, 1, 1):
            axes = ", ".join(axis.lower() for axis, sign in zip(order, signs) if sign < 0)
            yield Reading(
                f"whose angles about {axes} have the other sign",
                ANGLE_REMEDY,
                _of_rotations(
                    composed,
                    lambda rotation, order=order, signs=signs: [
                        Rotation.from_euler(order, rotation.as_euler(order) * signs)
                    ],
                ),
            )


def _angles_text(read: str, meant: str, columns: Sequence[int]) -> str:
    """Returns what differs: the order in which a camera turns about its axes, or which angle is that of which axis."""
    taken = [read[column] for column in columns]
    moved = [(old.lower(), new.lower()) for old, new in zip(taken, meant) if old != new]
    parts = [f"{meant} for {read}"] if meant != read else []
    if moved:
        parts.append(f"those about {', '.join(old for old, _ in moved)} are about {', '.join(new for _, new in moved)}")
    return "; ".join(parts)


def _both_angles(angles: Floats) -> list[Floats]:
    """Returns the two sets of Euler angles of each rotation, because a file may have either."""
    return [angles, np.stack([angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi], axis=1)]


def _of_rotations(composed: tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]], turn: Any) -> Transform:
    """Returns a transform of rotations that are composed of angles; centres stay."""
    from scipy.spatial.transform import Rotation

    to_composed, from_composed = composed

    def transform(poses: Poses) -> list[Poses]:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Gimbal lock")  # then any of the angles do
            turned = turn(Rotation.from_matrix(to_composed(poses.rotations)))
        return [Poses(from_composed(np.asarray(rotation.as_matrix())), poses.centres) for rotation in turned]

    return transform

"""Makes posed images of what a reader returns. What is bad is left out, and named in one line."""

import dataclasses
import functools
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.association import Association, associate
from colmap_lazyloc.pose_formats.calibration import read_calibration
from colmap_lazyloc.pose_formats.cameras import check_camera
from colmap_lazyloc.pose_formats.conventions import Convention, pose_of
from colmap_lazyloc.pose_formats.frames import Frame, apply
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.naming import clean
from colmap_lazyloc.pose_formats.posed_images import (
    PosedImage,
    PosedImages,
    Position,
    Positions,
    Source,
)
from colmap_lazyloc.pose_formats.raw_poses import DAMAGE, MAX_NUM_NAMED, BadPose, RawPose, RawPoses, reason_of
from colmap_lazyloc.poses import Pose

MIN_NUM_DEGREES = 3  # poses, fewer of which show nothing about their coordinates
MAX_DEGREES = 0.2  # that photos of a place are apart
FAR_RATIO, HIGH_RATIO = 20, 10  # of their distance from 0, and of their heights in metres, to this
MAX_REPEATED_ERROR = 1e-9  # of the numbers of two poses that are the same

T = TypeVar("T")
Poses = dict[int, Pose]  # by index in the file


def assemble(raw: RawPoses, convention: Convention, source: Source) -> PosedImages:
    """Returns the images of the poses of a file, which has this convention unless options specify another."""
    frame = _frame(raw.frame, source)
    if frame.is_in_degrees:
        convention = dataclasses.replace(convention, vector="degrees")
    if frame.is_geocentric and convention.is_of_angles:
        raise InputError(f"--crs {frame.crs}: {convention.rotation} are no angles about the axes of this system")
    convention = convention.with_options(source.pose_direction, source.camera_axes, source.quaternion_order)
    camera, cam_from_body = read_calibration(source)
    if cam_from_body is not None:
        if source.camera_axes is not None:
            raise InputError(f"--camera_axes {source.camera_axes}: --calibration says how the camera is mounted")
        convention = dataclasses.replace(convention, camera_axes="opencv")  # leaves the body's axes as they are

    def make_image(name: str, item: RawPose, pose: Pose) -> PosedImage:
        own = camera or _camera(item, name, source)
        return _checked(PosedImage(name, own, pose if cam_from_body is None else cam_from_body @ pose))

    images, origin = _assemble(raw, convention, frame, source, make_image)
    return PosedImages(images, origin, convention)


def assemble_poses(raw: RawPoses, convention: Convention, source: Source) -> dict[str, Pose]:
    """Returns the poses of photos by name, without intrinsics."""
    poses, _ = _assemble(raw, convention, raw.frame, source, lambda name, _, pose: (name, pose))
    return dict(poses)


def assemble_positions(raw: RawPoses, source: Source) -> Positions:
    """Returns where the photos of a file were taken, whose rotations mean nothing."""
    frame = _frame(raw.frame, source)
    vector = "degrees" if frame.is_in_degrees else "centre"

    def make_position(name: str, item: RawPose, pose: Pose) -> Position:
        x, y, z = pose.cam_in_world.tolist()
        return Position(name, (x, y, z), item.accuracy_m)

    convention = Convention("world_from_cam", rotation="matrix", vector=vector)
    photos, origin = _assemble(raw, convention, frame, source, make_position)
    return Positions(tuple(photos), origin, "positions")


def _assemble(
    raw: RawPoses, convention: Convention, frame: Frame, source: Source, make: Callable[[str, RawPose, Pose], T]
) -> tuple[list[T], GeoOrigin | None]:
    """Returns what is made of the poses that have a photo, by its name, and the origin of their frame."""
    raw, poses, left_out = _without_repeated(raw, convention)
    if not frame.is_geographic:
        _warn_of_degrees(poses, source)
    poses, origin = _to_local(poses, frame, source.origin, left_out)
    found = associate(raw.poses, source) if poses else Association({})
    left_out |= found.ambiguous
    made = []
    for name, (first, second, weight) in sorted(found.places.items()):
        item = raw.poses[first]
        if first in poses and second in poses and isinstance(item, RawPose):
            try:
                made.append(make(name, item, _between(poses[first], poses[second], weight)))
            except DAMAGE as error:
                left_out[first] = reason_of(error)
    _report(raw, found, left_out, bool(made), source)
    return made, origin


def _without_repeated(raw: RawPoses, convention: Convention) -> tuple[RawPoses, Poses, dict[int, str]]:
    """Returns the poses, of which those that a file has twice for a name or a frame are there once, and why others are
    none."""
    left_out = {index: item.reason for index, item in enumerate(raw.poses) if isinstance(item, BadPose)}
    poses = _convert(raw, convention, left_out)
    first_by_key: dict[Hashable, int] = {}
    repeated = set()
    for index, pose in poses.items():
        item = raw.poses[index]
        assert isinstance(item, RawPose)
        if item.name is None and item.frame is None:
            continue
        first = first_by_key.setdefault((item.name and clean(item.name), item.frame, item.time), index)
        if first != index and _is_same(pose, poses[first]) and _intrinsics(item) == _intrinsics(raw.poses[first]):
            repeated.add(index)
    if not repeated:
        return raw, poses, left_out
    kept = [index for index in range(len(raw.poses)) if index not in repeated]
    raw = dataclasses.replace(raw, poses=[raw.poses[index] for index in kept])
    places = {old: new for new, old in enumerate(kept)}
    poses = {places[index]: pose for index, pose in poses.items() if index in places}
    return raw, poses, {places[index]: reason for index, reason in left_out.items()}


def _is_same(first: Pose, second: Pose) -> bool:
    pairs = (first.rotation, second.rotation), (first.tvec, second.tvec)
    return all(np.allclose(a, b, MAX_REPEATED_ERROR, MAX_REPEATED_ERROR) for a, b in pairs)


def _intrinsics(item: RawPose | BadPose) -> Any:
    """Returns what is equal for two poses with the same intrinsics."""
    camera = None if isinstance(item, BadPose) else item.camera
    return (camera.func, camera.args) if isinstance(camera, functools.partial) else camera


def _convert(raw: RawPoses, convention: Convention, left_out: dict[int, str]) -> Poses:
    """Returns the poses that are ones."""
    poses = {}
    for index, item in enumerate(raw.poses):
        if isinstance(item, RawPose):
            try:
                pose = pose_of(item.rotation, item.vector, convention)
                poses[index] = pose if item.similarity is None else apply(item.similarity, pose)
            except DAMAGE as error:
                left_out[index] = reason_of(error)
    return poses


def _frame(frame: Frame, source: Source) -> Frame:
    """Returns the frame of a file by the options, each of which is used or refused."""
    if source.crs is not None and not (frame.is_geographic and source.shows_crs):
        if frame.is_geographic:
            raise InputError(f"--crs {source.crs}: {source.path} says itself where on the Earth its coordinates are")
        return dataclasses.replace(frame, crs=source.crs)
    if source.origin is not None and not frame.is_geographic:
        raise InputError(f"--geo_origin: {source.path} does not say where on the Earth its coordinates are: give --crs")
    return frame


def _warn_of_degrees(poses: Poses, source: Source) -> None:
    """Warns of x, y that look like longitude and latitude: near each other, and far from 0, beside metres in z."""
    if len(poses) < MIN_NUM_DEGREES:
        return
    centres = np.array([pose.cam_in_world for pose in poses.values()])
    middle, size = np.median(centres, axis=0), np.ptp(centres, axis=0)
    is_on_globe = abs(middle[0]) <= 180 and abs(middle[1]) <= 90
    if is_on_globe and 0 < max(size[:2]) < min(MAX_DEGREES, np.hypot(*middle[:2]) / FAR_RATIO, size[2] / HIGH_RATIO):
        logger.warning("%s: x, y look like degrees of longitude and latitude: give --crs EPSG:4326", source.path)


def _to_local(
    poses: Poses, frame: Frame, origin: GeoOrigin | None, left_out: dict[int, str]
) -> tuple[Poses, GeoOrigin | None]:
    """Returns the poses that are on the Earth in the local frame, and its origin."""
    if not poses:
        return poses, origin
    moved, origin = frame.to_local(list(poses.values()), origin)
    for index, pose in zip(poses, moved):
        if pose is None:
            left_out[index] = "its position is missing, or outside of the reference system"
    return {index: pose for index, pose in zip(poses, moved) if pose is not None}, origin


def _between(first: Pose, second: Pose, weight: float) -> Pose:
    """Returns the pose that is between two poses; `weight`: 0 at the first, 1 at the second."""
    if weight == 0:
        return first
    from scipy.spatial.transform import Rotation

    start = Rotation.from_matrix(first.rotation.T)
    turn = (start.inv() * Rotation.from_matrix(second.rotation.T)).as_rotvec()
    rotation = (start * Rotation.from_rotvec(weight * turn)).as_matrix()
    return Pose.from_centre(rotation.T, (1 - weight) * first.cam_in_world + weight * second.cam_in_world)


def _camera(item: RawPose, name: str, source: Source) -> Camera:
    """Returns the intrinsics that the file has for a photo."""
    if item.camera is None:
        raise ValueError("there are no intrinsics: give them as --camera")
    return item.camera if isinstance(item.camera, Camera) else item.camera(lambda: source.photos.size(name))


def _checked(image: PosedImage) -> PosedImage:
    """Returns an image that can be written and used."""
    if not image.name.isprintable() or not image.name:
        raise ValueError(f"a photo has the name {image.name!r}")
    check_camera(image.camera)
    if not np.all(np.isfinite([*image.cam_from_world.qvec, *image.cam_from_world.tvec])):
        raise ValueError("a pose has a value that is not finite")
    return image


def _report(raw: RawPoses, found: Association, left_out: dict[int, str], is_any: bool, source: Source) -> None:
    """Says how photos were found, and what was left out; it is an error if nothing is left."""
    path, folder = source.path, source.photos.folder
    named = some_of([f"{_label(raw, index)}: {left_out[index][:200]}" for index in sorted(left_out)])
    reasons = set(left_out.values())
    if not is_any and len(reasons) == 1 and len(left_out) > 1:
        named = f"all {len(left_out)}: {reasons.pop()[:200]}"
    if not is_any:
        where = f"is in {folder}" if folder else "has a pose"
        raise InputError(f"{path}: {f'no pose can be used: {named}' if named else f'no photo that it names {where}'}")
    if found.how:
        logger.info("%s: poses belong to photos %s", path, found.how)
    unused = set(range(len(raw.poses))).difference(left_out, *(place[:2] for place in found.places.values()))
    names = some_of([_label(raw, index) for index in sorted(unused)])
    if folder and unused and not found.is_by_time:
        logger.warning("%s: %d of %d poses have no photo in %s: %s", path, len(unused), len(raw.poses), folder, names)
    if left_out:
        verb = "is" if len(left_out) == 1 else "are"
        logger.warning("%s: %d of %d poses %s left out: %s", path, len(left_out), len(raw.poses), verb, named)


def _label(raw: RawPoses, index: int) -> str:
    """Returns what a pose is called in messages."""
    item = raw.poses[index]
    if isinstance(item, BadPose):
        return item.label
    if item.name is not None:
        return item.name[:80]
    return f"pose {index + 1}" if item.frame is None else f"frame {item.frame}"


def some_of(texts: Sequence[str]) -> str:
    """Returns the first of some texts, and how many more there are."""
    more = len(texts) - MAX_NUM_NAMED
    return "; ".join(texts[:MAX_NUM_NAMED]) + (f"; and {more} more" if more > 0 else "")

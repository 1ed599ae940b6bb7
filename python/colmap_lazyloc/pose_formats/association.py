"""Finds out which pose belongs to which photo: by name, by the frame's number, by time, or by the order."""

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.naming import Names, last_number, natural_key
from colmap_lazyloc.pose_formats.posed_images import Photos, Source
from colmap_lazyloc.pose_formats.raw_poses import BadPose, RawPose
from colmap_lazyloc.pose_formats.times import listed_times, places_between

MAX_COUNT = 10**8  # numbers below count photos; times are larger, or have a fraction

Items = Sequence[RawPose | BadPose]


@dataclasses.dataclass(frozen=True)
class Association:
    """The poses of photos: the indices of two poses and how far a photo is between them, 0 to 1, by photo.

    `ambiguous`: why a pose has no photo, by its index; `how`: what was used, empty for the names as they are.
    """

    places: Mapping[str, tuple[int, int, float]]
    ambiguous: Mapping[int, str] = dataclasses.field(default_factory=dict)
    how: str = ""
    is_by_time: bool = False  # then most poses have no photo


def associate(items: Items, source: Source) -> Association:
    """Finds the photos of poses by the first of these that the file has: names, numbers of frames, times, an order."""
    photos = source.photos
    poses = {index: item for index, item in enumerate(items) if isinstance(item, RawPose)}
    names = {index: item.name for index, item in poses.items() if item.name is not None}
    frames = {index: item.frame for index, item in poses.items() if item.frame is not None}
    times = {index: item.time for index, item in poses.items() if item.time is not None}
    if names:
        found = _by_name(names, photos)
        if found.places or not (frames or times):
            return found
    if photos.folder is None:
        raise InputError("--image_path is needed, because the file names no photos")
    if not photos.names:
        raise InputError(f"--image_path {photos.folder}: has no photos")
    if frames:
        numbers = _photo_numbers(photos)
        if not times or set(numbers.values()).intersection(frames.values()):
            return _by_frame(frames, numbers, source)
    if times:
        return _by_time(times, len(items), source)
    return _by_order(range(len(items)), source, "in the order of their names")


def _by_name(names: Mapping[int, str], photos: Photos) -> Association:
    indices = list(names)
    found = Names.match(list(names.values()), photos)
    places = {photo: (indices[index], indices[index], 0.0) for index, photo in found.photos.items()}
    ambiguous = {indices[index]: reason for index, reason in found.ambiguous.items()}
    return Association(places, ambiguous, f"by name, {found.how}" if found.how else "")


def _by_frame(frames: Mapping[int, int], numbers: Mapping[str, int], source: Source) -> Association:
    """Joins the numbers of frames with those in the names of the photos."""
    indices: dict[int, list[int]] = {}
    for index, frame in frames.items():
        indices.setdefault(frame, []).append(index)
    joined = {photo: indices[number] for photo, number in numbers.items() if number in indices}
    ambiguous = {
        index: f"two poses belong to '{photo}'" for photo, twins in joined.items() for index in twins if len(twins) > 1
    }
    is_shifted = len(joined) < len(numbers) == len(indices)
    if not joined or is_shifted:
        raise InputError(
            f"{source.path}: has the frames {_range(indices)}, but the photos in {source.photos.folder} have the "
            f"numbers {_range(numbers.values())}: name the photos by the numbers of their frames"
        )
    places = {photo: (twins[0], twins[0], 0.0) for photo, twins in joined.items() if len(twins) == 1}
    return Association(places, ambiguous, "by the numbers in the names")


def _by_time(times: Mapping[int, float], num_items: int, source: Source) -> Association:
    """Finds poses at the times of photos. Names that count are not times, but frames, if there are as many poses."""
    of_photos, where = listed_times(source), "from a list"
    if not of_photos:
        texts = {photo: text for photo in source.photos.names if (text := last_number(photo)) is not None}
        of_photos, where = {photo: float(text) for photo, text in texts.items()}, "from their names"
        if texts and all(_counts(text) for text in texts.values()):
            return _by_count(times, num_items, source)
    indices = list(times)
    found, apart = {}, 0.0
    if of_photos:
        places, apart = places_between(list(of_photos.values()), list(times.values()))
        found = {photo: (indices[at[0]], indices[at[1]], at[2]) for photo, at in zip(of_photos, places) if at}
    if not found:
        raise InputError(
            f"{source.path}: no photo is at a time of the trajectory, {_range(times.values())}: the photos' times, "
            f"{where}, are {_range(of_photos.values())}; give a list with lines `time name` beside it (rgb.txt)"
        )
    _check_one_camera({photo: of_photos[photo] for photo in found}, source)
    return Association(found, {}, f"by time, {1000 * apart:.3g} ms apart in the median", True)


def _by_count(times: Mapping[int, float], num_items: int, source: Source) -> Association:
    """Finds poses of photos whose names have numbers that count."""
    if len(source.photos.names) == num_items:
        return _by_order(range(num_items), source, "by the order of the numbers in the names, which are no times")
    if all(time == int(time) and abs(time) < MAX_COUNT for time in times.values()):
        return _by_frame({i: int(time) for i, time in times.items()}, _photo_numbers(source.photos), source)
    raise InputError(
        f"{source.path}: has {num_items} poses at the times {_range(times.values())}, but the names of the "
        f"{len(source.photos.names)} photos count: give a list with lines `time name` beside it (rgb.txt), or as many "
        "photos as poses"
    )


def _by_order(indices: Sequence[int], source: Source, how: str) -> Association:
    """Takes the poses in their order for the photos in the order of their names, 2 before 10."""
    photos = sorted(source.photos.names, key=natural_key)
    if len({photo.rpartition("/")[0] for photo in photos}) > 1:
        _photo_numbers(source.photos)
    if len(photos) != len(indices):
        raise InputError(
            f"{source.path}: has {len(indices)} poses, but {source.photos.folder} has {len(photos)} photos"
        )
    how += "" if photos == source.photos.names else ", 2 before 10"
    return Association({photo: (index, index, 0.0) for photo, index in zip(photos, indices)}, {}, how)


def _photo_numbers(photos: Photos) -> dict[str, int]:
    """Returns the numbers in the names of photos; refuses photos with the same number."""
    numbers = {name: int(text) for name in photos.names if (text := last_number(name) or "").isdecimal()}
    _refuse_twins(numbers, photos, "number, but the poses are those of one camera: give the folder of its photos")
    return numbers


def _check_one_camera(times: Mapping[str, float], source: Source) -> None:
    """Refuses photos of two cameras at the same time, because all photos get the poses of one."""
    _refuse_twins(
        times,
        source.photos,
        "time, but the trajectory is of one camera: give the folder of its photos, or the rig (lazyloc import "
        "--rig_config_path)",
    )


def _refuse_twins(values: Mapping[str, float], photos: Photos, text: str) -> None:
    """Refuses photos with the same value; `text`: what it is, and what to do."""
    names: dict[float, str] = {}
    for name, value in values.items():
        if names.setdefault(value, name) != name:
            raise InputError(f"--image_path {photos.folder}: {names[value]} and {name} have the same {text}")


def _counts(text: str) -> bool:
    return re.fullmatch(r"\d+", text) is not None and int(text) < MAX_COUNT


def _range(values: Iterable[float]) -> str:
    numbers = sorted(values)
    if not numbers:
        return "none"
    return f"{numbers[0]:.12g} to {numbers[-1]:.12g}"

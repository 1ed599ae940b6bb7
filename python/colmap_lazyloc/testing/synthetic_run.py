"""Writes the output folder of a run that never happened, of any size, for tests of what reads such folders.

    python -m colmap_lazyloc.testing.synthetic_run FOLDER --num_queries 10000 --num_points 1000000

Cameras stand along a street that winds over a square field, and look at what is beside it. FOLDER gets the files of
`colmap lazy_localizer`, truth/ (a model with the true poses of the queries) and, with --photos, images/.
"""

import argparse
import dataclasses
import json
import pathlib
import struct
from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
from numpy.random import Generator

from colmap_lazyloc import model
from colmap_lazyloc.array_types import Array
from colmap_lazyloc.poses import Pose, look_at
from colmap_lazyloc.results import RESULTS
from colmap_lazyloc.testing.synthetic import Camera
from colmap_lazyloc.text_files import Path

# fmt: off
FAILURES = (
    "UNREADABLE_IMAGE", "UNKNOWN_CAMERA", "NO_FEATURES", "NO_PAIRS", "DAMAGED_DATA", "TOO_FEW_INLIERS",
    "INCONSISTENT_ROTATIONS", "INCONSISTENT_RIG", "SCALE_UNOBSERVABLE", "DEGENERATE_BASELINE", "TOO_FEW_TRACKS",
    "INCONSISTENT_INTRINSICS", "DIVERGED", "LOW_CONFIDENCE",
)
# fmt: on
UGLY_NAMES = (
    "with blanks.jpg",
    'it\'s "quoted".jpg',
    "<script>alert(1)</script>.jpg",
    "<img src=x onerror=alert(1)>.jpg",
    "Fußgänger/日本 é.jpg",
    "line\nbreak.jpg",
    "back\\slash\\n.jpg",
    "&amp;%2F#hash?.jpg",
    "$(touch hacked) `touch hacked`.jpg",
    "constructor",
)
DATABASE_CAMERA = Camera(1, "PINHOLE", 640, 480, [500.0, 502.0, 321.0, 239.0])
QUERY_CAMERA = Camera(2, "SIMPLE_RADIAL", 600, 800, [640.0, 300.0, 400.0, -0.03])
SPACING = 1.0  # of the database images along the street
STREET_LENGTH = 100  # database images from one corner to the next
NUM_OBSERVERS = 3  # database images that may see a query's points
_POINT_HEAD = [("id", "<u8"), ("xyz", "<f8", 3), ("color", "u1", 3), ("error_px", "<f8"), ("track_length", "<u8")]


@dataclasses.dataclass(frozen=True)
class RunShape:
    """What the run is like."""

    num_queries: int = 30
    num_database_images: int = 40
    num_points: int = 3000
    num_pairs: int = 20
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame_size: int = 1  # queries of a frame
    has_failures: bool = True  # 14 of each 100 queries have one of FAILURES
    has_ugly_names: bool = False
    has_photos: bool = False
    seed: int = 0


@dataclasses.dataclass(eq=False)
class _Image:
    """An image and its keypoints."""

    name: str
    image_id: int
    camera: Camera
    pose: Pose
    keypoints: list[Array] = dataclasses.field(default_factory=list)  # arrays of model.POINT2D
    num_keypoints: int = 0

    def add(self, xy: Array, point_ids: Array | int) -> Array:
        """Adds keypoints of points; returns their indices."""
        added = np.zeros(len(xy), model.POINT2D)
        added["x"], added["y"], added["point3d_id"] = xy[:, 0], xy[:, 1], point_ids
        self.keypoints.append(added)
        self.num_keypoints += len(xy)
        return np.arange(self.num_keypoints - len(xy), self.num_keypoints)


def write_run(folder: Path, shape: RunShape = RunShape()) -> pathlib.Path:
    """Writes the folder of a run; returns it."""
    folder = pathlib.Path(folder)
    (folder / "model").mkdir(parents=True)
    rng = np.random.default_rng(shape.seed)
    database, queries = _make_images(shape, rng)
    truth = [_perturbed(query.pose, rng) for query in queries]
    with (folder / RESULTS).open("w", encoding="utf-8") as file:
        lines = [(query.name, _result(i, query, database, shape, rng)) for i, query in enumerate(queries)]
        for _, result in sorted(lines, key=lambda line: line[0]):
            file.write(json.dumps(result, ensure_ascii=False, separators=(",", ":")) + "\n")
    localized = [query for (_, result), query in zip(lines, queries) if result["status"] == "LOCALIZED"]
    del lines
    _write_points(folder / "model" / "points3D.bin", localized, database, shape, rng)
    _write_images(folder / "model" / "images.bin", database + localized)
    cameras = {camera.camera_id: camera.intrinsics() for camera in (DATABASE_CAMERA, QUERY_CAMERA)}
    (folder / "model" / "cameras.bin").write_bytes(_cameras(cameras))
    true_images = [model.Image(query.name, 2, pose, query.image_id) for query, pose in zip(queries, truth)]
    model.write_model(folder / "truth", cameras, true_images, binary=True)
    _write_options(folder / "options.ini", folder)
    if shape.has_photos:
        _write_photos(folder / "images", database + queries, rng)
    return folder


def _make_images(shape: RunShape, rng: Generator) -> tuple[list[_Image], list[_Image]]:
    """Returns the database images and the queries, along the street."""
    database_names = [f"database/{i:06d}.jpg" for i in range(shape.num_database_images)]
    query_names = [f"query/{i:06d}.jpg" for i in range(shape.num_queries)]
    if shape.has_ugly_names:
        for i, name in enumerate(UGLY_NAMES):
            database_names[i] = f"database/{name}"
            # Spread them over the queries with and without poses.
            query_names[3 * i] = f"query/{name}"
    database = [
        _Image(name, i + 1, DATABASE_CAMERA, _pose(i, shape, rng, 0.1)) for i, name in enumerate(database_names)
    ]
    step = shape.num_database_images / shape.num_queries
    queries = [
        _Image(name, len(database) + i + 1, QUERY_CAMERA, _pose((i + 0.5) * step, shape, rng, 0.4))
        for i, name in enumerate(query_names)
    ]
    return database, queries


def _pose(place: float, shape: RunShape, rng: Generator, noise: float) -> Pose:
    """Returns a pose at a place along the street, in database images from its beginning."""
    row, column = divmod(place, STREET_LENGTH)
    x = column if row % 2 == 0 else STREET_LENGTH - column
    centre = np.array([x * SPACING, 30 * row, 1.6]) + rng.normal(0, noise, 3)
    target = centre + [rng.normal(0, 0.15), 1, rng.normal(0, 0.05)]
    return Pose.from_centre(look_at(centre, target, (0, 0, -1), rng.normal(0, 2)), centre + shape.origin)


def _perturbed(pose: Pose, rng: Generator) -> Pose:
    """Returns the true pose of an estimate: its centre is off by a few millimetres."""
    return Pose.from_centre(pose.rotation, pose.cam_in_world + rng.normal(0, 0.004, 3))


def _result(i: int, query: _Image, database: list[_Image], shape: RunShape, rng: Generator) -> dict[str, object]:
    """Returns a line of results.jsonl."""
    status = FAILURES[i % 100] if shape.has_failures and i % 100 < len(FAILURES) else "LOCALIZED"
    has_pose = status in ("LOCALIZED", "LOW_CONFIDENCE")
    pose = {"qvec": query.pose.qvec.tolist(), "tvec": query.pose.tvec.tolist()}
    is_partial = status in ("SCALE_UNOBSERVABLE", "DEGENERATE_BASELINE")
    confidence = {"LOCALIZED": rng.uniform(0.94, 0.9945), "LOW_CONFIDENCE": rng.uniform(0, 0.94)}.get(status)
    stddevs = np.sort(rng.uniform(0.002, 0.01, 3))[::-1]
    is_together = shape.frame_size > 1
    return {
        "name": query.name,
        "status": status,
        "reason": "" if status == "LOCALIZED" else f"made up: {query.name} has the status {status}",
        "start": "absolute_pose" if has_pose else "",
        "confidence": confidence,
        "evidence": None if confidence is None else {"num_common_tracks": 120.0, "scene_distance": 8.0},
        "cam_from_world": pose if status == "LOCALIZED" else None,
        "unconfirmed_cam_from_world": pose if status == "LOW_CONFIDENCE" else None,
        "covariance": _covariance(query.pose, stddevs) if has_pose else None,
        "position_stddevs": stddevs.tolist() if has_pose else None,
        "weakest_direction": [1.0, 0.0, 0.0] if has_pose else None,
        "rotation_stddev_deg": rng.uniform(0.01, 0.1) if has_pose or is_partial else None,
        "rotation": query.pose.qvec.tolist() if is_partial else None,
        "bearing": _bearing(i, query, database, shape) if status == "SCALE_UNOBSERVABLE" else None,
        "frame": f"frame {i // shape.frame_size:06d}" if is_together else None,
        "rig_from_world": pose if is_together and status == "LOCALIZED" else None,
        "rig_error_px": rng.uniform(0.2, 0.8) if is_together else None,
        "intrinsics": {
            "origin": "given",
            "verdict": "confirmed" if has_pose else "not_tested",
            "focal_factor": 1.0002 if has_pose else None,
            "focal_factor_stddev": 0.0005 if has_pose else None,
            "contradiction": None,
        },
        "intrinsics_source": None if status == "UNREADABLE_IMAGE" else "query_list",
        "matching_type": "SIFT_BRUTEFORCE",
        "num_tracks": shape.num_points // shape.num_queries if has_pose else 0,
        "num_observations": 3 * shape.num_points // shape.num_queries if has_pose else 0,
        "mean_reprojection_error_px": rng.uniform(0.2, 1.0) if has_pose else None,
        "pairs": [] if status in FAILURES[:5] else _pairs(i, database, has_pose, shape, rng),
        "seconds": _seconds(rng),
    }


def _covariance(pose: Pose, stddevs: Array) -> list[list[float]]:
    """Returns the covariance of a pose whose centre has these standard deviations along the axes of the world."""
    x, y, z = pose.tvec
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    jacobian = np.block([[np.eye(3), np.zeros((3, 3))], [-cross, -pose.rotation]])
    covariance: Array = jacobian @ np.diag([4e-7] * 3 + list(stddevs**2)) @ jacobian.T
    return [list(map(float, row)) for row in covariance]


def _nearest(i: int, num: int, shape: RunShape) -> range:
    """Returns the indices of the database images nearest to a query along the street."""
    num = min(num, shape.num_database_images)
    place = int((i + 0.5) * shape.num_database_images / shape.num_queries)
    first = min(max(0, place - num // 2), shape.num_database_images - num)
    return range(first, first + num)


def _bearing(i: int, query: _Image, database: list[_Image], shape: RunShape) -> dict[str, object]:
    nearest = database[_nearest(i, 1, shape)[0]]
    direction = query.pose.cam_in_world - nearest.pose.cam_in_world
    return {"from": nearest.name, "direction": (direction / np.linalg.norm(direction)).tolist(), "stddev_deg": 0.8}


def _pairs(i: int, database: list[_Image], has_pose: bool, shape: RunShape, rng: Generator) -> list[dict[str, object]]:
    indices = _nearest(i, shape.num_pairs, shape)
    errors = rng.exponential(0.3, (len(indices), 2)).tolist()
    num_inliers = rng.integers(0, 500, len(indices))
    num_inliers[np.isin(indices, _nearest(i, NUM_OBSERVERS, shape))] += 500
    num_inliers = num_inliers.tolist()
    return [
        {
            "name": database[index].name,
            "num_inliers": num,
            "rotation_error_deg": error[0] if has_pose and num >= 50 else None,
            "direction_error_deg": error[1] if has_pose and num >= 50 else None,
        }
        for index, num, error in zip(indices, num_inliers, errors)
    ]


def _seconds(rng: Generator) -> dict[str, object]:
    stages = ("load", "two_view", "observations", "rotation", "tracks", "start", "triangulation", "adjustment")
    seconds = dict(zip(stages, rng.uniform(0, 0.01, len(stages)).tolist()))
    return {**seconds, "total": sum(seconds.values())}


def _write_points(
    path: pathlib.Path, queries: list[_Image], database: list[_Image], shape: RunShape, rng: Generator
) -> None:
    """Writes the points that the queries see, and adds their keypoints to the images."""
    index = {query.name: i for i, query in enumerate(queries)}
    num_points = 0
    with path.open("wb") as file:
        file.write(bytes(8))
        for query in queries:
            i = query.image_id - len(database) - 1
            observers = [database[k] for k in _nearest(i, NUM_OBSERVERS, shape)]
            num = shape.num_points // len(queries) + (index[query.name] < shape.num_points % len(queries))
            num_points += _add_points(file, query, observers, num, num_points + 1, rng)
            query.add(rng.uniform(0, [query.camera.width, query.camera.height], (10, 2)), -1)
        file.seek(0)
        file.write(struct.pack("<Q", num_points))


def _add_points(file: BinaryIO, query: _Image, observers: list[_Image], num: int, first_id: int, rng: Generator) -> int:
    """Adds points that a query and at least one observer see; returns their number."""
    xy = rng.uniform([-0.4, -0.5], [0.4, 0.5], (4 * num, 2))
    depth = rng.uniform(5, 14, (4 * num, 1))
    in_world = (np.hstack([xy * depth, depth]) - query.pose.tvec) @ query.pose.rotation
    projected = [image.camera.image_from_cam(image.pose(in_world)) for image in observers]
    size = [DATABASE_CAMERA.width - 5, DATABASE_CAMERA.height - 5]
    is_seen = np.array([np.all((xy > 5) & (xy < size), axis=1) for xy in projected])
    # Keep points that are in the nearest database image.
    kept = np.flatnonzero(is_seen[len(observers) // 2])[:num]
    in_world, is_seen, num = in_world[kept], is_seen[:, kept], len(kept)
    ids = np.arange(first_id, first_id + num)
    noise = rng.normal(0, 0.3, (num, 2))
    elements = [(query.image_id, query.add(query.camera.image_from_cam(query.pose(in_world)) + noise, ids))]
    for image, xy_in_image, seen in zip(observers, (xy[kept] for xy in projected), is_seen):
        keypoints = np.full(num, -1)
        keypoints[seen] = image.add(xy_in_image[seen] + noise[seen], ids[seen])
        elements.append((image.image_id, keypoints))
    track_lengths = 1 + is_seen.sum(axis=0)
    for track_length in np.unique(track_lengths):
        chosen = track_lengths == track_length
        points = np.zeros(chosen.sum(), [*_POINT_HEAD, ("track", "<u4", (int(track_length), 2))])
        points["id"], points["xyz"], points["error_px"] = ids[chosen], in_world[chosen], 0.3
        points["track_length"] = track_length
        in_track = np.stack([indices[chosen] for _, indices in elements], axis=1)
        image_ids = np.broadcast_to([image_id for image_id, _ in elements], in_track.shape)
        is_used = in_track >= 0
        points["track"] = np.stack([image_ids[is_used], in_track[is_used]], axis=1).reshape(-1, track_length, 2)
        file.write(points.tobytes())
    return num


def _write_images(path: pathlib.Path, images: list[_Image]) -> None:
    with path.open("wb") as file:
        file.write(struct.pack("<Q", len(images)))
        for image in images:
            file.write(struct.pack("<I", image.image_id) + image.pose.bits())
            file.write(struct.pack("<I", image.camera.camera_id) + image.name.encode() + b"\0")
            keypoints = np.concatenate([model.NO_POINTS, *image.keypoints])
            file.write(struct.pack("<Q", len(keypoints)) + keypoints.tobytes())


def _cameras(cameras: dict[int, model.Camera]) -> bytes:
    data = struct.pack("<Q", len(cameras))
    for camera_id, camera in cameras.items():
        model_id = model.CAMERA_MODEL_IDS[camera.model]
        data += struct.pack("<IiQQ", camera_id, model_id, camera.width, camera.height)
        data += np.array(camera.params, "<f8").tobytes()
    return data


def _write_options(path: pathlib.Path, folder: pathlib.Path) -> None:
    path.write_text(
        "# written by colmap_lazyloc 0.1.0, COLMAP 3.10\n"
        "# not defaults: LazyLocalizer.seed\n"
        f"database_path={folder}/database.db\ninput_path={folder}/input\noutput_path={folder}\n"
        "query_list_path=\nimage_path=\nstrict=0\n"
        "[LazyLocalizer]\nnum_retrieved=20\nseed=7\nleave_one_out=0\nmin_confidence=0.94\n"
        "[LazyLocalizer.Advanced]\ngroup_list_path=\nrig_noise_px=0.3\n",
        encoding="utf-8",
    )


def _write_photos(folder: pathlib.Path, images: list[_Image], rng: Generator) -> None:
    """Writes photos: a colour of their own, and a mark at each keypoint."""
    import cv2

    for image in images:
        pixels = np.empty((image.camera.height, image.camera.width, 3), np.uint8)
        pixels[:] = rng.integers(60, 200, 3)
        for keypoint in np.concatenate([model.NO_POINTS, *image.keypoints]):
            cv2.circle(pixels, (int(keypoint["x"]), int(keypoint["y"])), 3, (255, 255, 255), -1)
        path = folder / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        encoded = cv2.imencode(".jpg", pixels)[1]
        path.write_bytes(encoded.tobytes())


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, help="folder to write; must not exist")
    for name in ("num_queries", "num_database_images", "num_points", "num_pairs", "frame_size"):
        parser.add_argument(f"--{name}", type=int, default=getattr(RunShape, name), help="default: %(default)s")
    parser.add_argument("--origin", type=float, nargs=3, default=RunShape.origin, help="origin of the coordinates")
    parser.add_argument("--ugly_names", action="store_true", help="some names have blanks, quotes, HTML, a line break")
    parser.add_argument("--photos", action="store_true", help="write images/ as well")
    options = parser.parse_args(arguments)
    given = {name: value for name, value in vars(options).items() if name in RunShape.__annotations__}
    write_run(options.folder, RunShape(**given, has_ugly_names=options.ugly_names, has_photos=options.photos))


if __name__ == "__main__":
    main()

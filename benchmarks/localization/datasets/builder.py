"""Makes the files of a scene from a SceneSource: COLMAP text model, queries, protocol, and a database with SIFT
features and verified matches, made by pycolmap.
"""

import dataclasses
import hashlib
import itertools
import json
import pathlib
import sys

import numpy as np
import pycolmap
from scipy.spatial import cKDTree

from benchmarks.localization.datasets.scene_source import SceneSource
from benchmarks.localization.scenes import Scene, load_scene
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera, Image, write_model
from colmap_lazyloc.pycolmap_types import write_images

MAX_NUM_EXHAUSTIVE_PAIRS = 50_000
MAX_VIEWING_ANGLE_DEG = 60.0  # maximum angle between the viewing directions of neighbours


@dataclasses.dataclass(frozen=True)
class MatchingOptions:
    max_num_features: int = 8192
    pairs: tuple[tuple[str, str], ...] | None = None  # overrides the dataset's pairs
    num_database_neighbours: int = 20  # for the map: the nearest ones, with which each is matched


def build_scene(source: SceneSource, path: pathlib.Path, options: MatchingOptions) -> Scene:
    """Makes the scene in `path`; reuses an existing database that was made from the same input."""
    pairs = image_pairs(source, options)
    write_scene_files(source, path)
    link(source.image_path, path / "images")
    (path / "pairs.txt").write_text("".join(f"{name1} {name2}\n" for name1, name2 in pairs))

    contents = b"".join((path / name).read_bytes() for name in ("queries.txt", "pairs.txt"))
    contents += repr([(name, image.camera) for name, image in sorted(source.images.items())]).encode()
    stamp = json.dumps(
        {
            "sha256": hashlib.sha256(contents).hexdigest(),
            "images": str(source.image_path.resolve()),
            "max_num_features": options.max_num_features,
            "pycolmap": pycolmap.__version__,
        }
    )
    stamp_path = path / "database.json"
    if not (stamp_path.exists() and stamp_path.read_text() == stamp):
        stamp_path.unlink(missing_ok=True)
        print(f"{source.name}: matching {len(pairs)} pairs of {len(source.images)} images", file=sys.stderr, flush=True)
        _make_database(source, path, options)
        stamp_path.write_text(stamp)
    return load_scene(path)


def write_scene_files(source: SceneSource, path: pathlib.Path):
    """Writes model/ with all posed images, queries.txt (with intrinsics if there is no pose), protocol.json."""
    write_model(
        path / "model", _cameras(source), [image for image in _images(source) if image.cam_from_world is not None]
    )
    with (path / "queries.txt").open("w") as file:
        for name in source.query_names:
            image = source.images[name]
            file.write(f"{name}\n" if image.cam_from_world is not None else f"{name} {image.camera.text()}\n")
    (path / "protocol.json").write_text(json.dumps({"leave_one_out": source.leave_one_out}) + "\n")


def image_pairs(source: SceneSource, options: MatchingOptions) -> list[tuple[str, str]]:
    """Returns the pairs to match: queries with database images (as listed, or all), and database images with each
    other (as listed, or the nearest ones).
    """
    listed = options.pairs if options.pairs is not None else source.pairs
    database, queries = source.database_names, set(source.query_names)
    if listed is not None:
        pairs = [pair for pair in listed if all(name in source.images for name in pair)]
        if not any((name1 in queries) != (name2 in queries) for name1, name2 in pairs) and not source.leave_one_out:
            raise InputError(f"{source.name}: no pair of the list joins a query and a database image of the scene")
    else:
        pairs = list(
            itertools.combinations(sorted(source.images), 2)
            if source.leave_one_out
            else itertools.product(source.query_names, database)
        )
        if len(pairs) > MAX_NUM_EXHAUSTIVE_PAIRS:
            raise InputError(
                f"{source.name}: {len(pairs)} pairs are too many to match all; name a list of pairs with "
                "--pairs_path (hloc's form), or take fewer images with --image_step"
            )
    if not source.leave_one_out and not any(name1 not in queries and name2 not in queries for name1, name2 in pairs):
        pairs += neighbours(source, database, options.num_database_neighbours)
    return sorted({tuple(sorted(pair)) for pair in pairs if pair[0] != pair[1]})


def neighbours(source: SceneSource, names: list[str], count: int) -> list[tuple[str, str]]:
    """Pairs each database image with the `count` nearest ones that look in a similar direction."""
    if count <= 0 or len(names) < 2:
        return []
    poses = [source.images[name].cam_from_world for name in names]
    centres = np.array([pose.cam_in_world for pose in poses])
    directions = np.array([pose.rotation[2] for pose in poses])
    # Look for more neighbours than needed, because some look in other directions.
    _, idxs = cKDTree(centres).query(centres, min(len(names), 5 * count + 1))
    pairs = []
    for i, row in enumerate(idxs):
        cosines = directions[row] @ directions[i]
        near = [j for j, cosine in zip(row, cosines) if j != i and cosine >= np.cos(np.radians(MAX_VIEWING_ANGLE_DEG))]
        pairs += [(names[i], names[j]) for j in near[:count]]
    return pairs


def link(target: pathlib.Path, path: pathlib.Path):
    path.unlink(missing_ok=True)
    path.symlink_to(target.resolve())


def _camera_ids(source: SceneSource) -> dict[Camera, int]:
    """Numbers the distinct cameras in the order of the images' names."""
    cameras = dict.fromkeys(image.camera for _, image in sorted(source.images.items()))
    return {camera: camera_id for camera_id, camera in enumerate(cameras, 1)}


def _cameras(source: SceneSource) -> dict[int, Camera]:
    return {camera_id: camera for camera, camera_id in _camera_ids(source).items()}


def _images(source: SceneSource) -> list[Image]:
    camera_ids = _camera_ids(source)
    return [
        Image(name, camera_ids[image.camera], image.cam_from_world, image_id)
        for image_id, (name, image) in enumerate(sorted(source.images.items()), 1)
    ]


def _make_database(source: SceneSource, path: pathlib.Path, options: MatchingOptions):
    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
    making_path, database_path = path / "database_making.db", path / "database.db"
    for old_path in (making_path, database_path):
        old_path.unlink(missing_ok=True)
    with pycolmap.Database.open(making_path) as database:  # first, so that the extraction uses the given intrinsics
        write_images(database, _cameras(source), _images(source))
    extraction = pycolmap.FeatureExtractionOptions(use_gpu=False)
    extraction.sift.max_num_features = options.max_num_features
    pycolmap.extract_features(
        making_path,
        path / "images",
        image_names=sorted(source.images),
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )
    verification = pycolmap.TwoViewGeometryOptions(compute_relative_pose=True)
    verification.ransac.random_seed = 0
    pycolmap.match_image_pairs(
        making_path,
        pycolmap.FeatureMatchingOptions(use_gpu=False),
        pycolmap.ImportedPairingOptions(match_list_path=path / "pairs.txt"),
        verification,
        pycolmap.Device.cpu,
    )
    with pycolmap.Database.open(making_path) as database:
        if database.num_images() != len(source.images) or database.num_keypoints() == 0:
            raise InputError(f"{source.name}: features could not be extracted from the images in {source.image_path}")
    making_path.rename(database_path)

"""Converts features and matches in hloc's HDF5 files to a new COLMAP database for colmap lazy_localizer.

  python -m colmap_lazyloc.hloc_to_database --help

features: one group per image name, with `keypoints` (N x 2; the centre of the upper-left pixel is at 0, 0)
matches:  one group per pair, <name1>/<name2> with every "/" in a name replaced by "-" (older versions of hloc join the
          names by "_"), with `matches0`: for each keypoint of image 1 the index of its match in image 2, or -1
"""

import argparse
import pathlib
import sys
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError, Parser, command
from colmap_lazyloc.hloc_files import find_matches, read_keypoints
from colmap_lazyloc.model import Camera, Image, read_model
from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.queries import read_query_cameras
from colmap_lazyloc.text_files import Path


def read_cameras(model_path: Path, query_list_path: Path) -> tuple[dict[int, Camera], dict[str, int]]:
    """Reads the cameras by id, and the camera id of each image of the model and each query by name."""
    model = read_model(model_path)
    cameras, camera_ids = dict(model.cameras), {name: image.camera_id for name, image in model.images.items()}
    for name, camera in read_query_cameras(query_list_path).items():
        camera_ids[name] = max(cameras, default=0) + 1
        cameras[camera_ids[name]] = camera
    return cameras, camera_ids


def write_database(
    path: Path,
    cameras: Mapping[int, Camera],
    camera_ids: Mapping[str, int],
    keypoints: Mapping[str, NDArray[np.float32]],
    matches_of_pair: Mapping[tuple[str, str], NDArray[np.uint32]],
) -> None:
    """Writes the images that have keypoints, their cameras, and the matches by pairs of names."""
    import pycolmap

    from colmap_lazyloc.pycolmap_types import write_images

    images = [Image(name, camera_ids[name], None, image_id) for image_id, name in enumerate(sorted(keypoints), start=1)]
    ids = {image.name: image.image_id for image in images}
    used_ids = sorted({image.camera_id for image in images})
    with pycolmap.Database.open(str(path)) as database:
        write_images(database, {camera_id: cameras[camera_id] for camera_id in used_ids}, images)
        for name, image_id in ids.items():
            database.write_keypoints(image_id, keypoints[name])
        for (name1, name2), matches in matches_of_pair.items():
            database.write_matches(ids[name1], ids[name2], matches)


def convert(options: argparse.Namespace) -> None:
    import h5py
    import pycolmap  # noqa: F401, so that it is missed before anything is read

    if options.database_path.exists():
        raise InputError(f"{options.database_path}: exists already")
    cameras, camera_ids = read_cameras(options.model_path, options.query_list_path)
    pairs = read_pairs(options.pairs_path)
    keypoints, matches_of_pair = {}, {}
    with h5py.File(options.features_path, "r") as features, h5py.File(options.matches_path, "r") as matches:
        for name in sorted({name for pair in pairs for name in pair}):
            if name not in camera_ids:
                raise InputError(f"{options.pairs_path}: {name} is neither in the model nor in the query list")
            keypoints[name] = read_keypoints(features, name)
        for name1, name2 in pairs:
            found = find_matches(matches, name1, name2)
            if found is None:
                raise InputError(f"{options.matches_path}: has no matches of {name1} and {name2}")
            if (name2, name1) in matches_of_pair or len(found) == 0:
                continue
            if np.any(found >= [len(keypoints[name1]), len(keypoints[name2])]):
                raise InputError(f"{options.matches_path}: {name1}, {name2}: a match of a keypoint that is missing")
            matches_of_pair[name1, name2] = found
    write_database(options.database_path, cameras, camera_ids, keypoints, matches_of_pair)
    print(f"{options.database_path}: {len(keypoints)} images, {len(matches_of_pair)} pairs")


@command(extra="hloc")
def main(arguments: Sequence[str] | None = None) -> None:
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features_path", type=pathlib.Path, required=True, help="hloc's features of all images (.h5)")
    parser.add_argument("--matches_path", type=pathlib.Path, required=True, help="hloc's matches (.h5)")
    parser.add_argument(
        "--pairs_path", type=pathlib.Path, required=True, help="file with the image pairs, two names per line"
    )
    parser.add_argument(
        "--model_path", type=pathlib.Path, required=True, help="COLMAP model with the poses of the database images"
    )
    parser.add_argument(
        "--query_list_path",
        type=pathlib.Path,
        required=True,
        help="file with lines `name MODEL width height params...`",
    )
    parser.add_argument("--database_path", type=pathlib.Path, required=True, help="database to create")
    convert(parser.parse_args(arguments))


if __name__ == "__main__":
    sys.exit(main())

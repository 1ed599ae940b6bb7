#!/usr/bin/env python3
"""Writes features and matches of hloc's HDF5 files into a new COLMAP database, which colmap lazy_localizer reads.

  features: a group per image name with `keypoints` (N x 2; the centre of the upper-left pixel is at 0, 0)
  matches:  a group per pair, <name1>/<name2> with every "/" in a name replaced by "-" (or joined by "_", as older
            versions of hloc do), with `matches0`: for each keypoint of image 1 that of image 2, or -1
"""

import argparse
import pathlib
import sys

import h5py
import numpy as np
import pycolmap


class InputError(Exception):
    """A file that cannot be used; the message is one line."""


def read_lines(path):
    lines = (line.strip() for line in pathlib.Path(path).read_text(encoding="utf-8").splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def read_pairs(path):
    pairs = [line.split()[:2] for line in read_lines(path)]
    if not pairs or any(len(pair) < 2 for pair in pairs):
        raise InputError(f"{path}: expected two image names a line")
    return [tuple(pair) for pair in pairs if pair[0] != pair[1]]


def read_cameras(model_path, query_list_path):
    """Camera of each image: of the model's images, then of the queries, `name MODEL width height params...`."""
    cameras = {}
    model = pycolmap.Reconstruction(str(model_path))
    for image in model.images.values():
        cameras[image.name] = model.cameras[image.camera_id]
    camera_id = max(model.cameras, default=0)
    for line in read_lines(query_list_path):
        words = line.split()
        try:
            name, camera_model, (width, height), params = words[0], words[1], map(int, words[2:4]), words[4:]
            cameras[name] = pycolmap.Camera(camera_id=camera_id + 1, model=camera_model, width=width, height=height,
                                            params=[float(param) for param in params])
        except (IndexError, ValueError) as error:
            raise InputError(f"{query_list_path}: expected `name MODEL width height params...`, not '{line}'") from error
        camera_id += 1
    return cameras


def read_keypoints(features, name):
    """In COLMAP's pixels, where the centre of the upper-left pixel is at 0.5, 0.5."""
    if name not in features:
        raise InputError(f"{features.filename}: has no image {name}")
    return np.asarray(features[name]["keypoints"], np.float32)[:, :2] + np.float32(0.5)


def find_matches(matches, name1, name2):
    """Index pairs (M x 2), from whichever of hloc's names the pair has; None where it has none."""
    for first, second, columns in ((name1, name2, (0, 1)), (name2, name1, (1, 0))):
        for separator in ("/", "_"):
            key = separator.join(name.replace("/", "-") for name in (first, second))
            if key in matches:
                partners = np.asarray(matches[key]["matches0"])
                indices = np.flatnonzero(partners >= 0)
                return np.column_stack([indices, partners[indices]])[:, columns].astype(np.uint32)
    return None


def write_image(database, image_id, name, camera, keypoints):
    written = pycolmap.Image(name=name, camera_id=camera.camera_id, image_id=image_id)
    database.write_image(written, use_image_id=True)
    frame = pycolmap.Frame(frame_id=image_id, rig_id=camera.camera_id)
    frame.add_data_id(written.data_id)
    database.write_frame(frame, use_frame_id=True)
    database.write_keypoints(image_id, keypoints)


def write_database(path, cameras, keypoints, matches_of_pair):
    with pycolmap.Database.open(str(path)) as database:
        for camera in {cameras[name].camera_id: cameras[name] for name in keypoints}.values():
            database.write_camera(camera, use_camera_id=True)
            rig = pycolmap.Rig(rig_id=camera.camera_id)
            rig.add_ref_sensor(camera.sensor_id)
            database.write_rig(rig, use_rig_id=True)
        ids = {name: image_id for image_id, name in enumerate(sorted(keypoints), start=1)}
        for name, image_id in ids.items():
            write_image(database, image_id, name, cameras[name], keypoints[name])
        for (name1, name2), matches in matches_of_pair.items():
            database.write_matches(ids[name1], ids[name2], matches)


def convert(options):
    if options.database_path.exists():
        raise InputError(f"{options.database_path}: exists already")
    cameras = read_cameras(options.model_path, options.query_list_path)
    pairs = read_pairs(options.pairs_path)
    keypoints, matches_of_pair = {}, {}
    with h5py.File(options.features_path, "r") as features, h5py.File(options.matches_path, "r") as matches:
        for name in sorted({name for pair in pairs for name in pair}):
            if name not in cameras:
                raise InputError(f"{options.pairs_path}: {name} is neither in the model nor in the query list")
            keypoints[name] = read_keypoints(features, name)
        for name1, name2 in pairs:
            found = find_matches(matches, name1, name2)
            if found is None:
                raise InputError(f"{options.matches_path}: has no matches of {name1} and {name2}")
            if (name2, name1) in matches_of_pair or len(found) == 0:
                continue
            if np.any(found >= [len(keypoints[name1]), len(keypoints[name2])]):
                raise InputError(f"{options.matches_path}: {name1}, {name2}: a match names a keypoint that is not there")
            matches_of_pair[name1, name2] = found
    write_database(options.database_path, cameras, keypoints, matches_of_pair)
    print(f"{options.database_path}: {len(keypoints)} images, {len(matches_of_pair)} pairs")


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features_path", type=pathlib.Path, required=True, help="hloc's features of all images, .h5")
    parser.add_argument("--matches_path", type=pathlib.Path, required=True, help="hloc's matches, .h5")
    parser.add_argument("--pairs_path", type=pathlib.Path, required=True, help="two image names a line")
    parser.add_argument("--model_path", type=pathlib.Path, required=True, help="COLMAP model of the posed images")
    parser.add_argument("--query_list_path", type=pathlib.Path, required=True,
                        help="`name MODEL width height params...` a line")
    parser.add_argument("--database_path", type=pathlib.Path, required=True, help="the database to make")
    try:
        convert(parser.parse_args(arguments))
    except (InputError, OSError) as error:
        print(f"hloc_to_database.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

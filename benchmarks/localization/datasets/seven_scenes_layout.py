"""Writes a posed COLMAP scene in the layout of 7 Scenes: the database images are seq-01, the queries seq-02.

It makes the reader of the dataset (`--dataset 7scenes`) usable for a scene of which only a part is available, for
example one sequence of RedKitchen.
"""

import argparse
import pathlib

import cv2
import numpy as np

from benchmarks.localization.scenes import Scene, load_scene
from colmap_lazyloc.errors import command


def write_layout(scene: Scene, path: pathlib.Path):
    """Writes the scene to `path`, its folder in the dataset."""
    queries = set(scene.query_names)
    sequences = {1: [name for name in sorted(scene.images) if name not in queries], 2: sorted(queries)}
    for number, names in sequences.items():
        folder = path / f"seq-{number:02d}"
        folder.mkdir(parents=True, exist_ok=True)
        for index, name in enumerate(names):
            cv2.imwrite(str(folder / f"frame-{index:06d}.color.png"), cv2.imread(str(scene.path / "images" / name)))
            pose = scene.pose(name)
            world_from_cam = np.eye(4)
            world_from_cam[:3] = np.column_stack([pose.rotation.T, pose.cam_in_world])
            (folder / f"frame-{index:06d}.pose.txt").write_text(
                "".join("\t ".join(f"{value: .9e}" for value in row) + "\t\n" for row in world_from_cam)
            )
    (path / "TrainSplit.txt").write_text("sequence1\n")
    (path / "TestSplit.txt").write_text("sequence2\n")


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--scene_path", type=pathlib.Path, required=True, help="folder with model/ (text), images/ and queries.txt"
    )
    parser.add_argument(
        "--output_path", type=pathlib.Path, required=True, help="folder to write, for example DATA/redkitchen"
    )
    options = parser.parse_args(arguments)
    write_layout(load_scene(options.scene_path), options.output_path)

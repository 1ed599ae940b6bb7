"""7 Scenes (Shotton et al. 2013), as Microsoft Research distributes it:

    DATA/redkitchen/{TrainSplit,TestSplit}.txt           lines `sequence1`
    DATA/redkitchen/seq-01/frame-000000.color.png        640 x 480
    DATA/redkitchen/seq-01/frame-000000.pose.txt         4x4, world_from_cam, of KinectFusion

With `--ground_truth sfm`, poses, intrinsics and the split come from the COLMAP models of Brachmann et al. 2021
(github.com/tsattler/visloc_pseudo_gt_limitations, unpacked below DATA):

    DATA/7scenes_reference_models/redkitchen/sfm_gt/{cameras,images,points3D}.{bin,txt}, list_test.txt

A query is paired with the ten images that DenseVLAD retrieves, if hloc's file exists:

    DATA/7scenes_densevlad_retrieval_top_10/redkitchen_top10.txt
"""

import pathlib

import numpy as np

from benchmarks.localization.datasets.formats import lines_of, pose_of_matrix, read_source_images
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage, require
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.pose_formats.datasets import KINECT, read_split
from colmap_lazyloc.text_files import parse_numbers

SCENES = ("chess", "fire", "heads", "office", "pumpkin", "redkitchen", "stairs")
URL = "https://download.microsoft.com/download/2/8/5/28564B23-0828-408F-8631-23B1EFF1DAC8/{scene}.zip"
BY_HAND = (
    "7 Scenes is at https://www.microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes/ (for "
    "non-commercial use); unpack each scene's zip and the zips of its sequences into it, or use --download"
)
SFM_BY_HAND = "get the 7 Scenes models from https://github.com/tsattler/visloc_pseudo_gt_limitations"


def archives(scene_name: str) -> dict[str, str]:
    return {URL.format(scene=scene_name): "."}


def scene_names(data_path: pathlib.Path) -> list[str]:
    return [name for name in SCENES if (data_path / name / "TrainSplit.txt").exists()]


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    scene_path = require(data_path / name, BY_HAND)
    if options.ground_truth == "sfm":
        images, query_names = _read_sfm(data_path / "7scenes_reference_models" / name / "sfm_gt")
    else:
        images, query_names = _read_original(scene_path, options.focal_length_px or KINECT.params[0])
    # Keep every n-th database image and every n-th query.
    database_names = sorted(set(images) - set(query_names))[:: options.image_step]
    query_names = sorted(query_names)[:: options.image_step]
    kept = {image_name: images[image_name] for image_name in [*database_names, *query_names]}

    pairs_path = data_path / "7scenes_densevlad_retrieval_top_10" / f"{name}_top10.txt"
    pairs = tuple(read_pairs(pairs_path)) if pairs_path.exists() else None
    return SceneSource(name, scene_path, kept, tuple(query_names), pairs)


def _read_original(scene_path: pathlib.Path, focal_length_px: float) -> tuple[dict, list[str]]:
    camera = Camera(KINECT.model, KINECT.width, KINECT.height, (focal_length_px, *KINECT.params[1:]))
    images, query_names = {}, []
    for split in ("TrainSplit.txt", "TestSplit.txt"):
        for sequence in read_split(require(scene_path / split, BY_HAND)):
            names = _frame_names(scene_path, sequence)
            for name in names:
                pose_path = scene_path / name.replace(".color.png", ".pose.txt")
                images[name] = SourceImage(camera, read_pose(pose_path))
            if split == "TestSplit.txt":
                query_names += names
    return images, query_names


def _read_sfm(path: pathlib.Path) -> tuple[dict, list[str]]:
    images = read_source_images(require(path, SFM_BY_HAND))
    test_names = lines_of(require(path / "list_test.txt", SFM_BY_HAND))
    return images, [name for name in test_names if name in images]


def read_pose(path: pathlib.Path):
    require(path, BY_HAND)
    return pose_of_matrix(np.array(parse_numbers(path, path.read_text(), 16)).reshape(4, 4))


def _frame_names(scene_path: pathlib.Path, sequence: str) -> list[str]:
    paths = sorted((scene_path / sequence).glob("frame-*.color.png"))
    if not paths:
        raise InputError(f"{scene_path / sequence} holds no frame-*.color.png: unpack {sequence}.zip there")
    return [f"{sequence}/{path.name}" for path in paths]

"""Tests of the benchmark's dataset readers, on small files in the datasets' own formats and layouts."""

import pathlib
import re
import zipfile

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.localization import datasets, evaluation, run
from benchmarks.localization.datasets import aachen, cambridge, demo, formats, kitti, seven_scenes, strecha
from benchmarks.localization.datasets.builder import MatchingOptions, image_pairs, write_scene_files
from benchmarks.localization.datasets.download import download_archives
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage
from benchmarks.localization.datasets.seven_scenes_layout import write_layout
from benchmarks.localization.scenes import load_scene
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose
from conftest import DATA_PATH

OPTIONS = Options()
PINHOLE = Camera("PINHOLE", 640, 480, (500.0, 501.0, 320.0, 240.0))


def make_pose(seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    return Pose.from_matrix(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))


def write_image(path: pathlib.Path, width: int = 64, height: int = 48):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.zeros((height, width), np.uint8))


def assert_same_pose(pose: Pose, expected: Pose, tolerance: float = 1e-6):
    position_error, rotation_error_deg = pose.errors(expected)
    assert position_error < tolerance and rotation_error_deg < 100 * tolerance


# Shared formats


def test_hloc_query_list(tmp_path):
    path = tmp_path / "list.txt"
    path.write_text(
        "query/day/a.jpg SIMPLE_RADIAL 1600 1200 1469.2 800 600 -0.0353\n\n# comment\n"
        "./db/1.jpg OPENCV 10 20 1 2 3 4 5 6 7 8\n"
    )
    cameras = formats.read_query_list(path)
    assert cameras["query/day/a.jpg"] == Camera("SIMPLE_RADIAL", 1600, 1200, (1469.2, 800.0, 600.0, -0.0353))
    assert cameras["db/1.jpg"].params == (1, 2, 3, 4, 5, 6, 7, 8)
    path.write_text("a.jpg\n")
    with pytest.raises(InputError, match="list.txt"):
        formats.read_query_list(path)


def nvm_text(cameras: dict[str, tuple[float, Pose, float]]) -> str:
    """Returns the text of a VisualSFM file with these cameras and one point."""
    lines = [
        f"{name} {focal} {' '.join(map(str, pose.qvec))} {' '.join(map(str, pose.cam_in_world))} {radial} 0\n"
        for name, (focal, pose, radial) in cameras.items()
    ]
    return f"NVM_V3 \n\n{len(cameras)}\n{''.join(lines)}\n1\n1 2 3 128 128 128 2 0 7 -1.5 2.5 1 9 3.5 4\n\n\n\n0\n"


def test_nvm_cameras(tmp_path):
    poses = [make_pose(seed) for seed in (1, 2)]
    path = tmp_path / "reconstruction.nvm"
    path.write_text(nvm_text({"seq1/frame00001.jpg": (1670.5, poses[0], -0.04), "./db/1.jpg": (900, poses[1], 0)}))
    cameras = formats.read_nvm(path)
    assert list(cameras) == ["seq1/frame00001.jpg", "db/1.jpg"]
    assert cameras["seq1/frame00001.jpg"].focal_length_px == 1670.5
    assert_same_pose(cameras["seq1/frame00001.jpg"].cam_from_world, poses[0])
    assert_same_pose(cameras["db/1.jpg"].cam_from_world, poses[1])
    path.write_text("NVM_V3\n\n2\na.jpg 1 1 0 0 0 0 0 0 0 0\n")
    with pytest.raises(InputError, match="reconstruction.nvm: expected 10 numbers"):
        formats.read_nvm(path)


def test_nvm_distortion_is_turned_into_colmaps():
    """VisualSFM defines undistorted = distorted (1 + r |distorted|^2) on the normalized plane."""
    camera = formats.NvmCamera(1000.0, make_pose(0), 0.05).camera(1920, 1080)
    focal, cx, cy, k1, k2 = camera.params
    assert (camera.model, focal, cx, cy) == ("RADIAL", 1000, 960, 540)
    distorted = 0.4
    undistorted = distorted * (1 + 0.05 * distorted**2)
    assert undistorted * (1 + k1 * undistorted**2 + k2 * undistorted**4) == pytest.approx(distorted, abs=1e-5)


def test_image_size(tmp_path):
    for name in ("a.png", "a.jpg"):
        write_image(tmp_path / name, 33, 21)
        assert formats.image_size(tmp_path / name) == (33, 21)
    (tmp_path / "b.jpg").write_text("no image")
    with pytest.raises(InputError, match="b.jpg"):
        formats.image_size(tmp_path / "b.jpg")


def write_model(path: pathlib.Path, images: dict[str, SourceImage]):
    write_scene_files(SceneSource("s", path, images, ()), path)
    return path / "model"


# 7 Scenes


def write_seven_scenes(path: pathlib.Path) -> dict[str, Pose]:
    (path / "redkitchen").mkdir(parents=True)
    (path / "redkitchen" / "TrainSplit.txt").write_text("sequence1 \r\nsequence13\r\n")
    (path / "redkitchen" / "TestSplit.txt").write_text("sequence3\r\n")
    poses = {}
    for sequence, count in (("seq-01", 3), ("seq-13", 1), ("seq-03", 2)):
        for index in range(count):
            name = f"{sequence}/frame-{index:06d}.color.png"
            pose = poses[name] = make_pose(len(poses))
            write_image(path / "redkitchen" / name, 640, 480)
            world_from_cam = np.vstack([np.column_stack([pose.rotation.T, pose.cam_in_world]), [0, 0, 0, 1]])
            # The dataset's files have tabs, and exponents of three digits.
            rows = ([re.sub("(e[+-])", r"\g<1>0", f"{value: .7e}") for value in row] for row in world_from_cam)
            text = "".join("\t ".join(row) + "\t \n" for row in rows)
            (path / "redkitchen" / name.replace("color.png", "pose.txt")).write_text(text)
    return poses


def test_seven_scenes_layout(tmp_path):
    poses = write_seven_scenes(tmp_path)
    assert datasets.scene_names("7scenes", tmp_path) == ["redkitchen"]
    source = seven_scenes.read_scene(tmp_path, "redkitchen", OPTIONS)
    assert source.query_names == ("seq-03/frame-000000.color.png", "seq-03/frame-000001.color.png")
    assert source.database_names == [f"seq-01/frame-00000{i}.color.png" for i in range(3)] + [
        "seq-13/frame-000000.color.png"
    ]
    for name, pose in poses.items():
        assert_same_pose(source.images[name].cam_from_world, pose)
        assert source.images[name].camera == Camera("SIMPLE_PINHOLE", 640, 480, (525.0, 320.0, 240.0))
    assert source.pairs is None and not source.leave_one_out


def test_seven_scenes_options_and_retrieved_pairs(tmp_path):
    write_seven_scenes(tmp_path)
    folder = tmp_path / "7scenes_densevlad_retrieval_top_10"
    folder.mkdir()
    (folder / "redkitchen_top10.txt").write_text("seq-03/frame-000000.color.png seq-01/frame-000002.color.png\n")
    source = seven_scenes.read_scene(tmp_path, "redkitchen", Options(focal_length_px=532, image_step=2))
    assert source.pairs == (("seq-03/frame-000000.color.png", "seq-01/frame-000002.color.png"),)
    assert source.database_names == ["seq-01/frame-000000.color.png", "seq-01/frame-000002.color.png"]
    assert source.query_names == ("seq-03/frame-000000.color.png",)
    assert source.images[source.query_names[0]].camera.params[0] == 532


def test_seven_scenes_with_poses_of_structure_from_motion(tmp_path):
    poses = write_seven_scenes(tmp_path)
    images = {name: SourceImage(PINHOLE, make_pose(100 + i)) for i, name in enumerate(poses)}
    path = tmp_path / "7scenes_reference_models" / "redkitchen" / "sfm_gt"
    for file in write_model(tmp_path / "made", images).iterdir():
        path.mkdir(parents=True, exist_ok=True)
        file.rename(path / file.name)
    (path / "list_test.txt").write_text("seq-03/frame-000001.color.png\nseq-03/frame-000009.color.png\n")
    source = seven_scenes.read_scene(tmp_path, "redkitchen", Options(ground_truth="sfm"))
    assert source.query_names == ("seq-03/frame-000001.color.png",)
    assert source.images["seq-01/frame-000000.color.png"].camera == PINHOLE
    for name, image in images.items():
        assert_same_pose(source.images[name].cam_from_world, image.cam_from_world)


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("TrainSplit.txt", "seq-01\n", "seq-01"),
        ("seq-01/frame-000000.pose.txt", "1 2 3", "expected 16 numbers"),
        ("seq-01/frame-000000.pose.txt", "one", "expected numbers"),
        ("TestSplit.txt", "sequence9", "seq-09"),
    ],
)
def test_mistakes_in_seven_scenes_are_named(tmp_path, name, text, message):
    write_seven_scenes(tmp_path)
    (tmp_path / "redkitchen" / name).write_text(text)
    with pytest.raises(InputError, match=message):
        seven_scenes.read_scene(tmp_path, "redkitchen", OPTIONS)


def test_missing_data_says_where_to_get_it(tmp_path):
    with pytest.raises(InputError, match="microsoft.com"):
        seven_scenes.read_scene(tmp_path, "redkitchen", OPTIONS)
    write_seven_scenes(tmp_path)
    with pytest.raises(InputError, match="visloc_pseudo_gt_limitations"):
        seven_scenes.read_scene(tmp_path, "redkitchen", Options(ground_truth="sfm"))


def test_red_kitchen_goes_from_the_datasets_files_to_errors(colmap, tmp_path):
    """Extracts and matches features of every fifth image of a real scene and localizes two queries."""
    if not (DATA_PATH / "kitchen" / "images").exists():
        pytest.skip(f"no scene below {DATA_PATH}; LAZYLOC_SHARED_DATA says where it is")
    scene = load_scene(DATA_PATH / "kitchen")
    write_layout(scene, tmp_path / "data" / "redkitchen")
    source = seven_scenes.read_scene(tmp_path / "data", "redkitchen", OPTIONS)
    assert len(source.database_names) == 75 and len(source.query_names) == 25
    for name, true_name in zip(source.query_names, scene.query_names):
        assert_same_pose(source.images[name].cam_from_world, scene.pose(true_name))
    arguments = [
        "--dataset",
        "7scenes",
        "--data_path",
        str(tmp_path / "data"),
        "--focal_length_px",
        "532",
        "--image_step",
        "5",
        "--queries",
        "2",
        "--max_num_features",
        "4096",
        "--colmap",
        str(colmap),
        "--options",  # a right pose among database poses that are off by pixels has a confidence near the default
        "LazyLocalizer.min_confidence=0",
    ]
    assert run.main([*arguments, "--methods", "structure_based", "lazyloc", "--output_path", str(tmp_path)]) == 0
    rows = evaluation.read_csv(tmp_path / "run.csv")
    assert len(rows) == 4
    assert all(row.position_error_cm < 10 and row.rotation_error_deg < 3 for row in rows)


# Cambridge Landmarks


def write_cambridge(path: pathlib.Path) -> dict[str, Pose]:
    poses = {f"seq{i}/frame0000{i}.png": make_pose(i) for i in (1, 2, 3)}
    (path / "ShopFacade").mkdir(parents=True)
    for split, names in (("train", list(poses)[:2]), ("test", list(poses)[2:])):
        lines = [
            f"{name} {' '.join(f'{v:.6f}' for v in [*poses[name].cam_in_world, *poses[name].qvec])}\n" for name in names
        ]
        (path / "ShopFacade" / f"dataset_{split}.txt").write_text(
            "Visual Landmark Dataset V1\nImageFile, Camera Position [X Y Z W P Q R]\n\n" + "".join(lines)
        )
    for name in poses:
        write_image(path / "ShopFacade" / name, 192, 108)
    (path / "ShopFacade" / "reconstruction.nvm").write_text(
        nvm_text(
            {name.replace("png", "jpg"): (1600.0 + i, pose, 0.01 * i) for i, (name, pose) in enumerate(poses.items())}
        )
    )
    return poses


def test_cambridge_layout(tmp_path):
    poses = write_cambridge(tmp_path)
    assert datasets.scene_names("cambridge", tmp_path) == ["ShopFacade"]
    source = cambridge.read_scene(tmp_path, "ShopFacade", OPTIONS)
    assert source.query_names == ("seq3/frame00003.png",)
    for i, (name, pose) in enumerate(poses.items()):
        assert_same_pose(source.images[name].cam_from_world, pose, 1e-5)
        assert source.images[name].camera.params[:4] == (1600 + i, 96, 54, -0.01 * i)


def test_cambridge_with_the_models_of_1024_px(tmp_path):
    poses = write_cambridge(tmp_path)
    camera = Camera("SIMPLE_RADIAL", 96, 54, (80.0, 48.0, 27.0, -0.05))
    path = tmp_path / "CambridgeLandmarks_Colmap_Retriangulated_1024px" / "ShopFacade"
    write_model(path, {name: SourceImage(camera, pose) for name, pose in poses.items()}).rename(path / "empty_all")
    (path / "list_query.txt").write_text("seq2/frame00002.png\n")
    source = cambridge.read_scene(tmp_path, "ShopFacade", Options(ground_truth="sfm"))
    assert source.query_names == ("seq2/frame00002.png",)
    assert source.images["seq1/frame00001.png"].camera == Camera("SIMPLE_RADIAL", 192, 108, (160.0, 96.0, 54.0, -0.05))


def test_cambridge_image_without_a_camera_is_named(tmp_path):
    write_cambridge(tmp_path)
    (tmp_path / "ShopFacade" / "reconstruction.nvm").write_text(nvm_text({"seq1/frame00001.jpg": (1, make_pose(1), 0)}))
    with pytest.raises(InputError, match="seq2/frame00002.png"):
        cambridge.read_scene(tmp_path, "ShopFacade", OPTIONS)


# Aachen Day-Night


def write_aachen_queries(path: pathlib.Path):
    (path / "queries").mkdir(parents=True)
    (path / "images_upright").mkdir()
    (path / "queries" / "day_time_queries_with_intrinsics.txt").write_text(
        "query/day/nexus4/IMG_1.jpg SIMPLE_RADIAL 1600 1200 1469.2 800 600 -0.03\n"
    )
    (path / "queries" / "night_time_queries_with_intrinsics.txt").write_text(
        "query/night/nexus5x/IMG_2.jpg SIMPLE_RADIAL 1600 1200 1300.5 800 600 0.02\n"
    )


def test_aachen_v1_0_layout(tmp_path):
    write_aachen_queries(tmp_path)
    poses = {f"db/{i}.jpg": make_pose(i) for i in (1, 2)}
    (tmp_path / "3D-models").mkdir()
    (tmp_path / "3D-models" / "aachen_cvpr2018_db.nvm").write_text(
        nvm_text({f"./{name}": (1000, pose, 0) for name, pose in poses.items()})
    )
    (tmp_path / "3D-models" / "database_intrinsics.txt").write_text(
        "".join(f"{name} SIMPLE_RADIAL 1600 1063 1480 800 531.5 -0.11\n" for name in poses)
    )
    (tmp_path / "pairs" / "aachen").mkdir(parents=True)
    (tmp_path / "pairs" / "aachen" / "pairs-query-netvlad50.txt").write_text("query/day/nexus4/IMG_1.jpg db/2.jpg\n")
    assert datasets.scene_names("aachen", tmp_path) == ["aachen"]
    source = aachen.read_scene(tmp_path, "aachen", OPTIONS)
    assert source.query_names == ("query/day/nexus4/IMG_1.jpg", "query/night/nexus5x/IMG_2.jpg")
    assert source.images["query/night/nexus5x/IMG_2.jpg"].cam_from_world is None
    assert source.images["db/1.jpg"].camera == Camera("SIMPLE_RADIAL", 1600, 1063, (1480.0, 800.0, 531.5, -0.11))
    for name, pose in poses.items():
        assert_same_pose(source.images[name].cam_from_world, pose)
    assert source.pairs == (("query/day/nexus4/IMG_1.jpg", "db/2.jpg"),)


def test_aachen_v1_1_layout(tmp_path):
    import pycolmap

    write_aachen_queries(tmp_path)
    images = {f"db/{i}.jpg": SourceImage(PINHOLE, make_pose(i)) for i in (1, 2)}
    text_path = write_model(tmp_path / "made", images)
    binary_path = tmp_path / "3D-models" / "aachen_v_1_1"
    binary_path.mkdir(parents=True)
    pycolmap.Reconstruction(text_path).write_binary(binary_path)
    assert datasets.scene_names("aachen", tmp_path) == ["aachen_v1.1"]
    source = aachen.read_scene(tmp_path, "aachen_v1.1", OPTIONS)
    assert source.database_names == ["db/1.jpg", "db/2.jpg"] and len(source.query_names) == 2
    assert_same_pose(source.images["db/2.jpg"].cam_from_world, images["db/2.jpg"].cam_from_world)
    # Write the scene's files too: in them the queries have intrinsics instead of poses.
    write_scene_files(source, tmp_path / "scene")
    scene = load_scene(tmp_path / "scene")
    assert scene.database_names("query/night/nexus5x/IMG_2.jpg") == ["db/1.jpg", "db/2.jpg"]
    assert scene.camera("query/night/nexus5x/IMG_2.jpg").params == (1300.5, 800, 600, 0.02)
    assert scene.true_pose("query/night/nexus5x/IMG_2.jpg") is None


# Strecha, KITTI, demo


def test_strecha_camera_file(tmp_path):
    """The file has fountain-P11's intrinsics. Its rotation is world_from_cam; its first pixel's centre is (0, 0)."""
    pose = make_pose(3)
    path = tmp_path / "fountain-P11" / "gt_dense_cameras" / "0000.jpg.camera"
    path.parent.mkdir(parents=True)
    path.write_text(
        "2759.48 0 1520.69 \n0 2764.16 1006.81 \n0 0 1 \n0 0 0\n"
        + "".join(" ".join(map(str, row)) + " \n" for row in pose.rotation.T)
        + " ".join(map(str, pose.cam_in_world))
        + " \n3072 2048\n"
    )
    assert datasets.scene_names("strecha", tmp_path) == ["fountain-P11"]
    source = strecha.read_scene(tmp_path, "fountain-P11", OPTIONS)
    assert source.leave_one_out and source.query_names == ("0000.jpg",)
    image = source.images["0000.jpg"]
    assert image.camera == Camera("PINHOLE", 3072, 2048, (2759.48, 2764.16, 1521.19, 1007.31))
    assert_same_pose(image.cam_from_world, pose)


def test_kitti_layout(tmp_path):
    poses = [make_pose(seed) for seed in range(8)]
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses" / "04.txt").write_text(
        "".join(
            " ".join(f"{v:.8e}" for v in np.column_stack([pose.rotation.T, pose.cam_in_world]).ravel()) + "\n"
            for pose in poses
        )
    )
    write_image(tmp_path / "sequences" / "04" / "image_0" / "000000.png", 124, 37)
    projection = "7.0e+02 0 6.0e+01 {} 0 7.0e+02 1.8e+01 0 0 0 1 0"
    (tmp_path / "sequences" / "04" / "calib.txt").write_text(
        f"P0: {projection.format('0')}\nP1: {projection.format('-3.78e+02')}\nP2: {projection.format('40')}\n"
        f"P3: {projection.format('-300')}\nTr: {projection.format('0')}\n"
    )
    assert datasets.scene_names("kitti", tmp_path) == ["04"]
    source = kitti.read_scene(tmp_path, "04", OPTIONS)
    assert source.query_names == tuple(f"image_0/{i:06d}.png" for i in (1, 2, 4, 5, 7))
    assert source.database_names == [f"image_{side}/{i:06d}.png" for side in (0, 1) for i in (0, 3, 6)]
    assert_same_pose(source.images["image_0/000004.png"].cam_from_world, poses[4])
    # The right camera is 378 / 700 m to the right of the left one.
    right = source.images["image_1/000003.png"].cam_from_world.cam_in_world
    np.testing.assert_allclose(right, poses[3].cam_in_world + poses[3].rotation[0] * 0.54, atol=1e-6)
    assert source.images["image_1/000003.png"].camera == Camera("PINHOLE", 124, 37, (700.0, 700.0, 60.5, 18.5))
    assert ("image_0/000001.png", "image_1/000006.png") in source.pairs and len(source.pairs) == 5 * 6


def test_demo_layout(tmp_path):
    images = {f"database/00{i}.jpg": SourceImage(PINHOLE, make_pose(i)) for i in range(3)}
    write_model(tmp_path / "made", images).rename(tmp_path / "database_model")
    (tmp_path / "queries_with_intrinsics.txt").write_text("query/00.jpg RADIAL 840 560 583.7 415.2 284.9 -0.1 0.02\n")
    (tmp_path / "ground_truth").mkdir()
    (tmp_path / "ground_truth" / "poses.txt").write_text("# heading\nquery/00.jpg 1 0 0 0 1 2 3\n")
    source = demo.read_scene(tmp_path, "demo", OPTIONS)
    assert source.query_names == ("query/00.jpg",) and len(source.images) == 4
    np.testing.assert_allclose(source.images["query/00.jpg"].cam_from_world.tvec, [1, 2, 3])


# Datasets to scenes


def make_source(num_database: int = 4, **arguments) -> SceneSource:
    """Makes database cameras a metre apart along x, looking along z, except for the last one, which looks back."""
    turned = Rotation.from_euler("y", 180, degrees=True).as_matrix()
    images = {}
    for i in range(num_database):
        rotation = turned if i == num_database - 1 else np.eye(3)
        images[f"db/{i}.png"] = SourceImage(PINHOLE, Pose.from_centre(rotation, [float(i), 0, 0]))
    images["q.png"] = SourceImage(PINHOLE, Pose.from_matrix(np.eye(3), np.zeros(3)))
    return SceneSource("s", pathlib.Path("."), images, ("q.png",), **arguments)


def test_pairs_are_all_of_the_queries_and_near_ones_of_the_database():
    pairs = image_pairs(make_source(), MatchingOptions(num_database_neighbours=1))
    assert pairs == [
        ("db/0.png", "db/1.png"),
        ("db/0.png", "q.png"),
        ("db/1.png", "db/2.png"),
        ("db/1.png", "q.png"),
        ("db/2.png", "q.png"),
        ("db/3.png", "q.png"),
    ]


def test_listed_pairs_win_and_those_of_other_images_are_left_out():
    listed = (("q.png", "db/2.png"), ("db/1.png", "db/0.png"), ("q.png", "elsewhere.png"))
    expected = [("db/0.png", "db/1.png"), ("db/2.png", "q.png")]
    assert image_pairs(make_source(pairs=listed), MatchingOptions()) == expected
    assert image_pairs(make_source(), MatchingOptions(pairs=listed)) == expected
    with pytest.raises(InputError, match="no pair of the list"):
        image_pairs(make_source(), MatchingOptions(pairs=listed[1:]))


def test_leave_one_out_matches_all_with_all():
    source = make_source(leave_one_out=True)
    assert len(image_pairs(source, MatchingOptions())) == 5 * 4 // 2


def test_too_many_pairs_ask_for_a_list(monkeypatch):
    monkeypatch.setattr("benchmarks.localization.datasets.builder.MAX_NUM_EXHAUSTIVE_PAIRS", 3)
    with pytest.raises(InputError, match="--pairs_path"):
        image_pairs(make_source(), MatchingOptions())


def test_scene_files_are_read_back(tmp_path):
    source = make_source()
    write_scene_files(source, tmp_path)
    scene = load_scene(tmp_path)
    assert scene.query_names == ["q.png"]
    assert scene.database_names("q.png") == [f"db/{i}.png" for i in range(4)]
    for name, image in source.images.items():
        assert scene.camera(name) == image.camera
        np.testing.assert_array_equal(scene.pose(name).tvec, image.cam_from_world.tvec)


def test_folder_takes_a_model_and_its_database_as_they_are(tmp_path):
    source = make_source()
    data_path = tmp_path / "mine"
    write_model(tmp_path / "made", source.images)
    (data_path / "sparse").mkdir(parents=True)
    (tmp_path / "made" / "model").rename(data_path / "sparse" / "0")
    (data_path / "database.db").write_bytes(b"a database")
    assert datasets.scene_names("folder", data_path) == ["mine"]

    def prepare():
        return datasets.prepare_scene("folder", data_path, "mine", OPTIONS, MatchingOptions(), tmp_path / "work")

    scene = prepare()
    assert scene.protocol.leave_one_out and len(scene.query_names) == 5
    assert scene.database_path.read_bytes() == b"a database"
    (data_path / "queries.txt").write_text("q.png\n")
    scene = prepare()
    assert scene.query_names == ["q.png"] and scene.database_names("q.png") == source.database_names
    (data_path / "queries.txt").write_text("nowhere.png\n")
    with pytest.raises(InputError, match="nowhere.png"):
        prepare()


def test_download_unpacks_zips_within_zips(tmp_path):
    with zipfile.ZipFile(tmp_path / "seq-01.zip", "w") as inner:
        inner.writestr("seq-01/frame-000000.pose.txt", "1")
    with zipfile.ZipFile(tmp_path / "redkitchen.zip", "w") as outer:
        outer.write(tmp_path / "seq-01.zip", "redkitchen/seq-01.zip")
        outer.writestr("redkitchen/TrainSplit.txt", "sequence1")
    data_path = tmp_path / "data"
    download_archives({(tmp_path / "redkitchen.zip").as_uri(): "."}, data_path, "by hand")
    assert sorted(str(path.relative_to(data_path)) for path in data_path.rglob("*") if path.is_file()) == [
        "redkitchen/TrainSplit.txt",
        "redkitchen/seq-01/frame-000000.pose.txt",
    ]
    with pytest.raises(InputError, match="nothing.zip.*By hand: ask"):
        download_archives({(tmp_path / "nothing.zip").as_uri(): "."}, data_path, "ask")

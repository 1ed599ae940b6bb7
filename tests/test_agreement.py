"""Poses that the photos contradict: they are found and named; right ones and inexact ones are not."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.corrupted_poses import (
    CORRUPTIONS,
    Scene,
    disturb,
    explain_scene,
    focal_length,
    of_angles,
    photo_missing,
    shifted,
    turned_photos,
)
from colmap_lazyloc.agreement import relative
from colmap_lazyloc.agreement.check import describe, judge
from colmap_lazyloc.agreement.contradictions import contradicted_images
from colmap_lazyloc.agreement.explain import EXACT_PX, Fit
from colmap_lazyloc.agreement.own_cameras import own_cameras
from colmap_lazyloc.agreement.pairs import MatchedPair
from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px, medians_by_pair
from colmap_lazyloc.agreement.turned import images_of_second_poses
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.conventions import CAMERA_AXES, COLMAP, DIRECTIONS, Convention, pose_of
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.poses import Pose, look_at

FOCAL_PX = 600.0
NOISE_PX = 0.5
CAMERA = Camera("PINHOLE", 640, 480, (FOCAL_PX, FOCAL_PX, 320.0, 240.0))


def make_scene(step_rad=(0.04, 0.16)):
    """Makes cameras on an uneven walk around points, with noisy rays of pairs: at most three apart, or at random.

    `step_rad`: the least and the largest step of the walk, seen from the points.
    """
    random = np.random.default_rng(3)
    count = 40
    points = random.uniform(-3, 3, (400, 3)) * [1, 1, 0.5]
    angles = np.cumsum(random.uniform(*step_rad, count))
    radii = random.uniform(6, 9, count)
    centres = np.stack([radii * np.cos(angles), radii * np.sin(angles), random.uniform(-1.5, 2.5, count)], axis=1)
    rotations = np.array(
        [look_at(centre, random.uniform(-1, 1, 3), (0, 0, -1), random.uniform(-15, 15)) for centre in centres]
    )

    def rays(camera, chosen):
        inside = (points[chosen] - centres[camera]) @ rotations[camera].T
        inside = inside / inside[:, 2:] + np.pad(
            random.normal(0, NOISE_PX / FOCAL_PX, (len(chosen), 2)), ((0, 0), (0, 1))
        )
        return inside / np.linalg.norm(inside, axis=1, keepdims=True)

    pairs = []
    near = [(first, first + random.integers(1, 4)) for first in range(0, count - 3)]
    for first, second in [*near[:30], *random.choice(count, (30, 2), replace=True).tolist()]:
        if first != second:
            chosen = random.choice(len(points), 40, replace=False)
            pairs.append(MatchedPair(int(first), int(second), rays(first, chosen), rays(second, chosen), FOCAL_PX))
    return Scene([f"image_{index:03d}.jpg" for index in range(count)], Poses(rotations, centres), pairs)


@pytest.fixture(scope="module")
def scene():
    return make_scene()


def test_errors_are_the_noise_of_the_keypoints(scene):
    matches = Matches.of(scene.pairs)
    errors = medians_by_pair(matches, errors_px(matches, scene.poses, scene.poses))
    assert 0.2 < np.median(errors) < 1.0


def test_points_behind_a_camera_do_not_fit(scene):
    # Epipolar lines are the same if all positions are mirrored at a point, but all depths are negative.
    mirrored = dataclasses.replace(scene.poses, centres=-scene.poses.centres)
    matches = Matches.of(scene.pairs)
    errors = medians_by_pair(matches, errors_px(matches, mirrored, mirrored))
    assert np.median(errors) > 50


def test_images_from_one_place_need_parallel_rays():
    rays = np.array([[0.0, 0, 1], [0.6, 0, 0.8]])
    matches = Matches.of([MatchedPair(0, 1, rays, rays, FOCAL_PX)])
    poses = Poses(np.array([np.eye(3)] * 2), np.zeros((2, 3)))
    assert np.allclose(errors_px(matches, poses, poses), 0)
    turned = dataclasses.replace(poses, rotations=np.array([np.eye(3), Rotation.from_euler("z", 0.1).as_matrix()]))
    assert errors_px(matches, turned, turned)[1] == pytest.approx(FOCAL_PX * 0.06, rel=0.01)


def is_wrong(explanation):
    return explanation.reading is not None or explanation.is_hopeless


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_corruption_is_named(scene, name):
    corrupt, title = CORRUPTIONS[name]
    explanation = explain_scene(corrupt(scene))
    assert is_wrong(explanation)
    assert title in describe(explanation, "units")


@pytest.mark.parametrize("name", ["OpenGL's axes", "inverse poses", "quaternion order", "mirrored axes", "another set"])
def test_corruption_of_inexact_poses_is_named(scene, name):
    corrupt, title = CORRUPTIONS[name]
    explanation = explain_scene(corrupt(disturb(scene, degrees=2, share=0.03)))
    assert title in describe(explanation, "units")


@pytest.mark.parametrize(
    ("num_off", "px", "rotation_deg", "needs"),
    [
        (20, 0.3, 8, False),  # matches of near photos hardly determine rotations
        (5, 0.9, 8, True),
        (4, 0.9, 8, False),
        (5, 3, 0.1, True),
        (4, 3, 0.1, False),
        (20, 2.5, 0.1, True),
    ],
)
def test_what_needs_an_explanation(num_off, px, rotation_deg, needs):
    rows = [(px, rotation_deg)] * num_off + [(0.2, 0.1)] * (20 - num_off)
    assert Fit(*np.array(rows).T).needs_explanation == needs


def test_right_poses_agree(scene):
    explanation = explain_scene(scene)
    assert not is_wrong(explanation)
    assert describe(explanation, "m").startswith(
        f"poses agree with the photos: {len(scene.pairs)} of {len(scene.pairs)}"
    )


@pytest.mark.parametrize(("degrees", "share"), [(0.5, 0.005), (2, 0.03), (5, 0.1)])
def test_inexact_poses_agree_within_their_errors(scene, degrees, share):
    explanation = explain_scene(disturb(scene, degrees, share))
    assert not is_wrong(explanation)
    # Two poses with this error differ by 1.4 times as much.
    assert np.median(explanation.given.rotation_deg) == pytest.approx(1.4 * degrees, rel=0.4, abs=0.5)


def test_rotations_of_a_drone_without_a_gimbal_are_rough(scene):
    explanation = explain_scene(disturb(scene, degrees=14, share=0.01))
    assert 15 < np.median(explanation.given.rotation_deg) < 25
    assert not is_wrong(explanation)
    assert describe(explanation, "m").startswith("poses agree with the photos only roughly: ")


CONVENTIONS = [
    Convention(direction, axes, rotation="matrix")
    for direction, axes in itertools.product(DIRECTIONS, ("opencv", "opengl", "body"))
]


@pytest.mark.parametrize("written", CONVENTIONS, ids=str)
def test_remedy_is_what_the_file_was_written_by(scene, written):
    axes, rotations = CAMERA_AXES[written.camera_axes], scene.poses.rotations
    matrices, vectors = axes @ rotations, -np.einsum("nij,nj->ni", axes @ rotations, scene.poses.centres)
    if written.direction == "world_from_cam":
        matrices, vectors = np.swapaxes(axes @ rotations, 1, 2), scene.poses.centres
    for read in (CONVENTIONS[0], CONVENTIONS[4]):
        if read == written:
            continue
        given = scene.with_poses(*read_poses(matrices, vectors, read))
        words = explain_scene(given, read).reading.remedy.removeprefix("give ").split()
        options = dict(zip(words[::2], words[1::2]))
        assert options.get("--pose_direction", read.direction) == written.direction
        assert options.get("--camera_axes", read.camera_axes) == written.camera_axes


@pytest.mark.parametrize("vector", ["centre", "degrees"])
@pytest.mark.parametrize("written", CONVENTIONS, ids=str)
def test_remedy_of_rotations_beside_centres(scene, written, vector):
    """Where the file has centres, the other direction is that of the rotations alone, and its world stays."""
    rotations = CAMERA_AXES[written.camera_axes] @ scene.poses.rotations
    if written.direction == "world_from_cam":
        rotations = np.swapaxes(rotations, 1, 2)
    for read in (CONVENTIONS[0], CONVENTIONS[1], CONVENTIONS[4]):
        read = dataclasses.replace(read, vector=vector)
        is_same = (read.direction, read.camera_axes) == (written.direction, written.camera_axes)
        if is_same or (vector == "centre" and read.direction == "world_from_cam"):
            continue
        options = dict.fromkeys(("--pose_direction", "--camera_axes", "--quaternion_order"))
        given = scene.with_poses(*read_poses(rotations, scene.poses.centres, read))
        words = explain_scene(given, read).reading.remedy.removeprefix("give ").split()
        options.update(zip(words[::2], words[1::2]))
        again = read.with_options(*options.values())
        found = read_poses(rotations, scene.poses.centres, again)
        assert np.allclose(found[0], scene.poses.rotations) and np.allclose(found[1], scene.poses.centres)


def read_poses(rotations, vectors, convention):
    """Returns the rotations and the centres of what a file has."""
    poses = [pose_of(*raw, convention) for raw in zip(rotations, vectors)]
    return np.array([p.rotation for p in poses]), np.array([p.cam_in_world for p in poses])


def test_poses_in_the_order_of_letters(scene):
    names = [f"image_{index}.jpg" for index in range(len(scene.names))]
    written = scene.poses.take(np.argsort(names))  # which is read in the order of numbers
    explanation = explain_scene(dataclasses.replace(scene, names=names, poses=written))
    assert "in the order 1, 10, 2 of letters, where the photos have 1, 2, 10" in explanation.reading.title


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda a: Rotation.from_euler("ZXY", a[:, [0, 2, 1]]), "(those about y, x are about x, y)"),
        (lambda a: Rotation.from_euler("XYZ", a[:, [1, 2, 0]]), "(ZXY for XYZ)"),
    ],
)
def test_title_says_how_angles_differ(scene, change, text):
    explanation = explain_scene(of_angles(change)(scene))
    assert explanation.reading.title.endswith(f"whose angles are in another order {text}")


def test_poses_of_images_that_are_late(scene):
    for number in (1, -3):
        explanation = explain_scene(shifted(number)(scene))
        assert f"{abs(number)} place" in explanation.reading.title


def test_focal_length_beside_inexact_positions():
    """Where a camera turns little and positions are inexact, as those of GPS, the focal length follows from rotations
    that are hardly off."""
    inexact = disturb(make_scene(step_rad=(0.012, 0.048)), degrees=0.1, share=0.3)
    assert not is_wrong(explain_scene(inexact))
    explanation = explain_scene(focal_length(1.2)(inexact))
    assert 1.5 < np.median(explanation.given.rotation_deg) < 3
    assert "focal lengths times 1.2" in explanation.reading.title


def test_photos_of_which_some_are_turned_are_named(scene):
    turned = turned_photos(90)(scene)
    images = [PosedImage(n, CAMERA, Pose.from_centre(*pose)) for n, *pose in zip(
        scene.names, turned.poses.rotations, turned.poses.centres)]  # fmt: skip
    found = judge(scene.pairs, images, COLMAP, is_metric=True)
    assert found.is_wrong
    compared = {index for pair in scene.pairs for index in (pair.first, pair.second)}
    count = len(compared.intersection(range(13, 26)))
    names = "image_013.jpg, image_014.jpg, image_015.jpg"
    assert (
        f"some are turned by 270 degrees, as by EXIF's orientation ({count} of {len(compared)}: {names}" in found.line
    )
    chosen = images_of_second_poses(Matches.of(scene.pairs), turned.poses, scene.poses)
    assert chosen == sorted(compared.intersection(range(13, 26)))


def test_photos_behind_a_missing_one_are_named(scene):
    behind = photo_missing(scene)
    images = [PosedImage(n, CAMERA, Pose.from_centre(*pose)) for n, *pose in zip(
        scene.names, behind.poses.rotations, behind.poses.centres)]  # fmt: skip
    found = judge(scene.pairs, images, COLMAP, is_metric=True)
    assert found.is_wrong
    compared = {index for pair in scene.pairs for index in (pair.first, pair.second)}
    moved = sorted(compared.intersection(range(len(images) // 2 + 1, len(images))))
    names = f"{len(moved)} of {len(compared)}: {images[moved[0]].name}, "
    assert f"each is that of the photo 1 place earlier ({names}" in found.line


def test_too_few_pairs_say_nothing(scene):
    assert explain_scene(dataclasses.replace(scene, pairs=scene.pairs[:4])) is None


def test_displaced_images_are_named_and_no_others(scene):
    centres = scene.poses.centres.copy()
    centres[[5, 20]] += [0, 0, 1.0]
    displaced = dataclasses.replace(scene, poses=dataclasses.replace(scene.poses, centres=centres))
    assert not is_wrong(explain_scene(displaced))
    matches = Matches.of(scene.pairs)
    errors = medians_by_pair(matches, errors_px(matches, displaced.poses, displaced.poses))
    assert sorted(contradicted_images([(pair.first, pair.second) for pair in scene.pairs], errors)) == [5, 20]


def test_images_are_named_if_half_of_the_pairs_are_off():
    pairs = list(itertools.combinations(range(10), 2))
    wrong = {2, 5, 7}
    errors = np.array([15.0 if wrong.intersection(pair) else 0.2 for pair in pairs])
    assert np.median(errors) == 15
    assert set(contradicted_images(pairs, errors)) == wrong


def test_image_with_a_single_pair_is_named():
    pairs = [*itertools.combinations(range(5), 2), (3, 5)]
    errors = np.array([0.2] * 10 + [15.0])
    assert contradicted_images(pairs, errors) == [5]


def test_images_without_pairs_are_named_as_not_compared(scene):
    images = [PosedImage(n, CAMERA, Pose.from_centre(*pose)) for n, *pose in zip(
        scene.names, scene.poses.rotations, scene.poses.centres)]  # fmt: skip
    images += [dataclasses.replace(images[0], name=f"alone_{index}.jpg") for index in range(5)]
    line = judge(scene.pairs, images, COLMAP, is_metric=True).line
    assert line.endswith("; not compared: image_038.jpg, alone_0.jpg, alone_1.jpg and 3 more")


def test_camera_for_each_image_is_named(scene):
    def images_with(focal_lengths, offset_px=0.0):
        cameras = [Camera("SIMPLE_RADIAL", 640, 480, (f, 320.0 + offset_px, 240.0, 0.0)) for f in focal_lengths]
        return [PosedImage(n, camera, Pose.from_centre(*pose)) for n, camera, *pose in zip(
            scene.names, cameras, scene.poses.rotations, scene.poses.centres)]  # fmt: skip

    random = np.random.default_rng(0)
    ours = (FOCAL_PX * np.exp(random.normal(0, 0.005, len(scene.names)))).tolist()
    own = images_with(ours)
    assert own_cameras(own).startswith("each of the 40 images has a camera of its own (half of their focal lengths are")
    assert judge(scene.pairs, own, COLMAP, is_metric=True).lines()[-1] == own_cameras(own)
    one_camera, many_cameras = [FOCAL_PX] * 40, (FOCAL_PX * np.exp(random.normal(0, 0.5, 40))).tolist()
    measured_by_device = images_with(ours, offset_px=3.0)
    others = [*map(images_with, (one_camera, many_cameras, ours[:4], [*ours[1:], ours[1]])), measured_by_device]
    spherical = [
        dataclasses.replace(image, camera=Camera("EQUIRECTANGULAR", 640 + i, 320, (640.0 + i, 320.0)))
        for i, image in enumerate(own)
    ]
    assert [own_cameras(images) for images in [*others, spherical]] == [""] * 6
    assert len(judge(scene.pairs, others[0], COLMAP, is_metric=True).lines()) == 1


def test_pairs_that_no_image_explains_are_named(scene):
    """The pose of an image is off so that few of its pairs show it, or the matches of a pair are wrong."""
    images = [PosedImage(n, CAMERA, Pose.from_centre(*pose)) for n, *pose in zip(
        scene.names, scene.poses.rotations, scene.poses.centres)]  # fmt: skip
    pair = scene.pairs[0]
    found = judge([pair.with_focal_factor(3.0), *scene.pairs[1:]], images, COLMAP, is_metric=True)
    assert not found.is_wrong and not found.contradicted
    assert f"; these do not fit: {images[pair.first].name} with {images[pair.second].name}" in found.line
    assert "do not fit" not in judge(scene.pairs, images, COLMAP, is_metric=True).line


@pytest.mark.parametrize(("px", "verdict"), [(1.5, "photos: "), (3.0, "photos within their errors: ")])
def test_poses_with_errors_of_pixels_do_not_simply_agree(scene, px, verdict):
    explanation = explain_scene(disturb(scene, 0.1, 0.001))
    given = dataclasses.replace(explanation.given, px=np.full(len(scene.pairs), px))
    assert describe(dataclasses.replace(explanation, given=given), "m").startswith(f"poses agree with the {verdict}")


def test_relative_poses_are_estimated_only_if_matches_do_not_fit(scene, monkeypatch):
    estimated = []

    def estimate(pair):
        estimated.append(pair)
        return original(pair)

    original = relative._estimate
    monkeypatch.setattr(relative, "_estimate", estimate)
    right = explain_scene(scene)
    matches = Matches.of(scene.pairs)
    errors = medians_by_pair(matches, errors_px(matches, scene.poses, scene.poses))
    assert right.given.agrees and len(estimated) == np.count_nonzero(errors > EXACT_PX) < len(scene.pairs) / 2
    wrong = explain_scene(CORRUPTIONS["OpenGL's axes"][0](scene))
    assert wrong.reading is not None and len(estimated) > len(scene.pairs)

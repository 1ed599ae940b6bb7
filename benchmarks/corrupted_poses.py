"""Corrupts the poses of scenes in the ways in which people's files are wrong, and asks whether the check names them.

    scripts/python.sh -m benchmarks poses ../shared/data/herzjesu ../shared/data/skull

A scene is a folder with database.db and model/. A cell is `right` if the corruption is named, `found` if the check says
only that the poses are wrong, `small` if it moves no pair by more than 5 px, else `missed`. The last rows are false
alarms: `quiet` is right. With --noise, position and rotation of each image are disturbed first.
"""

import argparse
import dataclasses
import pathlib
import time
from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from colmap_lazyloc.agreement.explain import Explanation, explain
from colmap_lazyloc.agreement.pairs import MatchedPair, pairs_of_database
from colmap_lazyloc.agreement.photo_pairs import pairs_of_photos
from colmap_lazyloc.agreement.poses import Matches, Poses, errors_px, medians_by_pair
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.model import read_model
from colmap_lazyloc.pose_formats.angles import LEVEL_CAMERA
from colmap_lazyloc.pose_formats.conventions import CAMERA_AXES, COLMAP, Convention
from colmap_lazyloc.pose_formats.naming import natural_order
from colmap_lazyloc.pose_formats.posed_images import PosedImage

MOVED_PX = 5.0
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """Images by name with their poses, and their matched pairs."""

    names: list[str]
    poses: Poses
    pairs: list[MatchedPair]

    def with_poses(self, rotations, centres):
        return dataclasses.replace(self, poses=Poses(rotations, centres))


def transposed(rotations):
    return np.swapaxes(rotations, 1, 2)


def turn_by(vectors, rotations):
    return np.einsum("nij,nj->ni", rotations, vectors)


def with_turned_camera(turn):
    return lambda scene: scene.with_poses(turn @ scene.poses.rotations, scene.poses.centres)


def inverse(scene):
    rotations = scene.poses.rotations
    return scene.with_poses(transposed(rotations), -turn_by(scene.poses.centres, rotations))


def turned_photos(degrees):
    """A third of the photos, one after the other, are turned: those of a drone's way back."""
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()

    def corrupt(scene):
        order = np.array(natural_order(scene.names))
        rotations = scene.poses.rotations.copy()
        some = order[len(order) // 3 : 2 * len(order) // 3]
        rotations[some] = turn @ rotations[some]
        return scene.with_poses(rotations, scene.poses.centres)

    return corrupt


def quaternion_order(scene):
    """World_from_cam written as w, x, y, z and read as x, y, z, w."""
    xyzw = Rotation.from_matrix(transposed(scene.poses.rotations)).as_quat()
    read = Rotation.from_quat(np.roll(xyzw, 1, axis=1)).as_matrix()
    return scene.with_poses(transposed(read), scene.poses.centres)


def mirrored(scene):
    return scene.with_poses(MIRROR @ scene.poses.rotations @ MIRROR, scene.poses.centres @ MIRROR)


def of_angles(change):
    """Yaw, pitch and roll of a level camera that are read in another way."""

    def corrupt(scene):
        angles = Rotation.from_matrix(transposed(scene.poses.rotations) @ LEVEL_CAMERA.T).as_euler("ZXY")
        return scene.with_poses(transposed(change(angles).as_matrix() @ LEVEL_CAMERA), scene.poses.centres)

    return corrupt


def lexical_order(scene):
    """Photos with numbers without leading zeros, whose poses come in the order of the numbers, but are read in that of
    the letters."""
    names = [f"image_{index}.jpg" for index in range(len(scene.names))]
    taken = np.empty(len(names), int)
    taken[sorted(range(len(names)), key=lambda index: names[index])] = np.arange(len(names))
    moved = scene.poses.take(taken)
    return dataclasses.replace(scene, names=names, poses=moved)


def shifted(number):
    def corrupt(scene):
        order = np.array(natural_order(scene.names))
        places = np.clip(np.argsort(order) + number, 0, len(order) - 1)
        return dataclasses.replace(scene, poses=scene.poses.take(order[places]))

    return corrupt


def photo_missing(scene):
    """A photo in the middle that has a pose is missing: those behind it have the poses of the ones before them."""
    order = np.array(natural_order(scene.names))
    places = np.argsort(order)
    return dataclasses.replace(scene, poses=scene.poses.take(order[places - (places > len(order) // 2)]))


def of_another_set(scene):
    """Poses of another walk through a place of the same size."""
    random = np.random.default_rng(5)
    count, centres = len(scene.names), scene.poses.centres
    walk = np.cumsum(random.normal(size=(count, 3)), axis=0)
    walk = (walk - walk.mean(axis=0)) / walk.std() * centres.std() + centres.mean(axis=0)
    turns = Rotation.from_euler("y", np.cumsum(random.normal(size=count)) * 0.5).as_matrix()
    return scene.with_poses(turns @ scene.poses.rotations[:1], walk)


def grid(degrees):
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return lambda scene: scene.with_poses(scene.poses.rotations @ turn, scene.poses.centres)


def focal_length(factor):
    """Intrinsics of photos of another size: the given focal length is right times the factor."""

    return lambda scene: dataclasses.replace(scene, pairs=[pair.with_focal_factor(1 / factor) for pair in scene.pairs])


# Each corruption, and a word of the title that names it.
CORRUPTIONS: dict[str, tuple[Callable[[Scene], Scene], str]] = {
    "OpenGL's axes": (with_turned_camera(CAMERA_AXES["opengl"]), "camera axes of opengl"),
    "axes of a body": (with_turned_camera(CAMERA_AXES["body"]), "camera axes of body"),
    "inverse poses": (inverse, "read as world_from_cam"),
    "quaternion order": (quaternion_order, "quaternions in the other order"),
    "mirrored axes": (mirrored, "left-handed"),
    "radians": (of_angles(lambda a: Rotation.from_euler("ZXY", np.radians(a))), "radians"),
    "angle order": (of_angles(lambda a: Rotation.from_euler("XYZ", a[:, [1, 2, 0]])), "angles are in another order"),
    # Of some numbers of photos, the order of the letters is its own inverse.
    "lexical order": (lexical_order, "in the order 1, "),
    "shift of 2": (shifted(2), "2 places"),
    "a photo missing": (photo_missing, "the last ones are shifted"),
    "another set": (of_another_set, "other photos"),
    "grid of 2 degrees": (grid(2.05), "rotations turned by"),
    "half the focal length": (focal_length(2.0), "focal lengths times"),
    "EXIF's orientation": (
        with_turned_camera(Rotation.from_euler("z", 90, degrees=True).as_matrix()),
        "photos that are turned by",
    ),
    "some photos turned": (turned_photos(180), "some are turned by 180 degrees"),
}


def read_scene(folder: pathlib.Path, by_photos: bool) -> Scene:
    model = read_model(folder / "model")
    images = [
        PosedImage(image.name, model.cameras[image.camera_id], image.pose)
        for image in sorted(model.images.values(), key=lambda image: image.name)
    ]
    if by_photos:
        pairs = pairs_of_photos(folder / "images", images)
    else:
        with DatabaseReader(folder / "database.db") as database:
            pairs = pairs_of_database(database, images)
    rotations = np.array([image.cam_from_world.rotation for image in images])
    centres = np.array([image.cam_from_world.cam_in_world for image in images])
    return Scene([image.name for image in images], Poses(rotations, centres), pairs)


def disturb(scene: Scene, degrees: float, share: float) -> Scene:
    """Adds noise to poses: of rotations in degrees, of positions as a share of the scene's size."""
    random, count = np.random.default_rng(7), len(scene.names)
    size = np.median(np.linalg.norm(scene.poses.centres - np.median(scene.poses.centres, axis=0), axis=1))
    turns = Rotation.from_rotvec(np.radians(degrees) / np.sqrt(3) * random.normal(size=(count, 3))).as_matrix()
    centres = scene.poses.centres + share * size / np.sqrt(3) * random.normal(size=(count, 3))
    return scene.with_poses(turns @ scene.poses.rotations, centres)


def explain_scene(scene: Scene, convention: Convention = COLMAP) -> Explanation | None:
    return explain(scene.pairs, scene.names, scene.poses, convention)


def errors_of(scene: Scene):
    matches = Matches.of(scene.pairs)
    return medians_by_pair(matches, errors_px(matches, scene.poses, scene.poses))


def judge(explanation: Explanation | None, title: str, moved_px: float) -> str:
    if explanation is None:
        return "too few"
    if explanation.reading is not None:
        return "right" if title in explanation.reading.title else f"found: {explanation.reading.title}"
    if explanation.is_hopeless:
        return "right" if title == "other photos" else "found: other photos"
    return "missed" if moved_px > MOVED_PX else "small"


def judge_given(explanation: Explanation | None) -> str:
    if explanation is None:
        return "too few"
    return "quiet" if explanation.reading is None and not explanation.is_hopeless else "FALSE ALARM"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    parser.add_argument("--noise", nargs=2, type=float, metavar=("DEG", "SHARE"), help="of the given poses")
    parser.add_argument("--photos", action="store_true", help="match photos instead of reading the database's matches")
    options = parser.parse_args(arguments)
    counts: dict[str, int] = {}
    for folder in options.scenes:
        scene = read_scene(folder, options.photos)
        if options.noise:
            scene = disturb(scene, *options.noise)
        before = errors_of(scene)
        explanation = explain_scene(scene)
        rows = {"as it is": judge_given(explanation)}
        start = time.process_time()
        for name, (corrupt, title) in CORRUPTIONS.items():
            corrupted = corrupt(scene)
            moved_px = float(np.max(np.abs(errors_of(corrupted) - before)))
            explanation = explain_scene(corrupted)
            rows[name] = judge(explanation, title, moved_px)
        seconds = (time.process_time() - start) / len(CORRUPTIONS)
        print(f"{folder.name}: {len(scene.names)} images, {len(scene.pairs)} pairs, median {np.median(before):.2f} px,"
              f" {seconds:.1f} s each", flush=True)  # fmt: skip
        for name, row in rows.items():
            counts[row.split(":")[0]] = counts.get(row.split(":")[0], 0) + 1
            if row not in ("right", "quiet"):
                print(f"  {name:24}{row}")
    print(", ".join(f"{count} {name}" for name, count in sorted(counts.items())))
    return 0

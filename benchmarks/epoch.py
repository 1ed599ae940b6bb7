"""Measures `lazyloc run --epoch`: new photos localized alone, adjusted together, and in a joint model that may move.

    scripts/python.sh -m benchmarks epoch --work_path WORK --scene courtyard half survey room ../shared/data/fountain

courtyard, half, survey, room: two epochs are rendered from one world, the second one with another camera, other light,
and a box each that was moved and taken away. In half, the database has half of the walk, so that some photos show what
only other new photos see. The room has a ceiling, and furniture that hides parts of it. A folder of a scene (images/,
model/): its photos in two halves by the order of their names, every second one, or with --split blocks the second half
of the sequence.

Position errors are in thousandths of the model's unit (mm for metres). `free` is COLMAP's bundle_adjuster on the model
of both epochs, moved to the database positions by a similarity. The last lines are those of `lazyloc changes`: in a
rendered scene, one box has moved by 0.4, -0.3, 0, and one is gone at 6.9, 3.4 (room: 1.6, 0.6). Nothing has changed in
the halves of a scene.
"""

import argparse
import dataclasses
import json
import pathlib
import shutil
import subprocess
import sys
import time
import unittest.mock

import numpy as np
from scipy.spatial.transform import Rotation

from colmap_lazyloc.model import Camera, read_model, write_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.project.steps import find_program
from colmap_lazyloc.results import RESULTS, read_results, to_pose

MAX_RIGHT_SIGMA, MAX_RIGHT_RATIO = 5, 0.005  # as in docs/method.md
LATER_SUN = np.array([-0.6, 0.4, 0.5])  # of the second epoch


def rendered(name: str, folder: pathlib.Path, seed: int, count: int) -> dict[str, Pose]:
    """Renders both epochs of a world and writes the database model; returns the true poses of the new photos."""
    from colmap_lazyloc.demo import scene, survey
    from colmap_lazyloc.demo.scene import QUERY_CAMERA, View

    if name == "room":
        return rendered_room(folder, seed, count)
    rng = np.random.default_rng([seed, 77])
    if name == "survey":
        old, _ = survey.make_views(np.random.default_rng([seed, 20]))
        grid = [(x, y) for y in np.linspace(-3.4, 3.4, 5) for x in np.linspace(-5.2, 5.2, 8)][:count]
        new = [
            View(f"new/{i:03}.jpg", QUERY_CAMERA, view.pose) for i, view in enumerate(survey._views(rng, grid, "", 0.4))
        ]
        old = [View(f"database/{view.name}", view.camera, view.pose) for view in old]
    else:
        old, new = scene.database_views(seed, 40), scene.query_views(seed, count)
        if name == "half":
            old = old[:20]
        new = [View(f"new/{i:03}.jpg", QUERY_CAMERA, view.pose) for i, view in enumerate(new)]
    texels = 110 if name == "survey" else 220
    scene.write_images(folder / "database", scene.build_scene(seed, texels), old, seed, stream=3)
    # A month later: one box is gone, one has moved by half a metre, and the sun stands elsewhere.
    boxes = scene.BOXES
    moved = dataclasses.replace(boxes[4], centre=(-1.1, -1.2, 0))
    later_boxes = (*boxes[:4], moved, *boxes[5:7], *boxes[8:])
    with unittest.mock.patch.multiple(scene, BOXES=later_boxes, SUN=LATER_SUN):
        later = scene.build_scene(seed, texels)
    scene.write_images(folder / "new", later, new, seed, stream=4)
    scene.write_database_model(folder / "model", [View(pathlib.Path(v.name).name, v.camera, v.pose) for v in old])
    return {pathlib.Path(view.name).name: view.pose for view in new}


def rendered_room(folder: pathlib.Path, seed: int, count: int) -> dict[str, Pose]:
    from colmap_lazyloc.demo import scene, textures
    from colmap_lazyloc.demo.scene import Box, View

    rng = np.random.default_rng([seed, 78])
    wood, brown = textures.planks, (75, 120, 150)
    furniture = [
        Box((-2.65, 1.0, 0), (0.6, 1.2, 2.0), 0, wood, brown),
        Box((0.8, 2.0, 0), (1.6, 0.4, 1.8), 0, textures.facade, (150, 165, 190)),
        Box((0.3, 0.3, 0), (1.1, 0.7, 0.75), 10, wood, (70, 115, 160)),
        Box((0.4, 0.3, 0.75), (0.4, 0.3, 0.25), 40, wood, (80, 130, 165)),
        Box((2.6, -1.8, 0), (0.5, 0.5, 1.2), -12, textures.stone, (140, 150, 160)),
    ]
    chest = Box((-0.7, -0.6, 0), (0.5, 0.4, 0.45), -20, wood, (60, 100, 150))
    stool = Box((1.6, 0.6, 0), (0.45, 0.45, 0.6), 5, wood, brown)
    moved = dataclasses.replace(chest, centre=(-0.3, -0.9, 0))

    def view(name: str, camera: Camera, angle: float, turn_deg: float) -> View:
        while True:
            place = np.array([2.3 * np.cos(angle), 1.7 * np.sin(angle), 1.5]) + rng.normal(0, [0.15, 0.15, 0.15])
            if min(box.distance(place) for box in (*furniture, chest, stool, moved)) > 0.3:
                break
            angle += 0.1
        heading = angle + np.pi + np.radians(rng.uniform(-turn_deg, turn_deg))
        target = place + [np.cos(heading), np.sin(heading), rng.uniform(-0.4, 0.1)]
        return View(name, camera, scene.upright_pose(place, target, rng.normal(0, 2)))

    old = [view(f"{i:03}.jpg", scene.DATABASE_CAMERA, 2 * np.pi * i / 40, 40) for i in range(40)]
    new = [view(f"{i:03}.jpg", scene.QUERY_CAMERA, rng.uniform(0, 2 * np.pi), 50) for i in range(count)]
    size = np.array([6.0, 4.5, 4.0])  # the lowest wall ends at the ceiling
    for views, label, stream, things, sun in (
        (old, "database", 3, [chest, stool], scene.SUN),
        (new, "new", 4, [moved], LATER_SUN),
    ):
        with unittest.mock.patch.multiple(scene, SIZE=size, BOXES=(*furniture, *things), SUN=sun):
            ceiling = scene._paint(
                np.random.default_rng([seed, 79]), np.array([-3, -2.25, 2.6]), np.array([6.0, 0, 0]),
                np.array([0, 4.5, 0]), textures.paving, 220, (200, 200, 200)
            )  # fmt: skip
            scene.write_images(folder / label, [*scene.build_scene(seed, 220), ceiling], views, seed, stream)
    scene.write_database_model(folder / "model", old)
    return {view.name: view.pose for view in new}


def split(source: pathlib.Path, folder: pathlib.Path, blocks: bool) -> dict[str, Pose]:
    """Links the photos of a scene into two halves; returns as `rendered` does."""
    model = read_model(source / "model")
    names = sorted(name for name in model.images if (source / "images" / name).exists())
    new = names[len(names) // 2 :] if blocks else names[1::2]
    for name in names:
        path = folder / ("new" if name in new else "database") / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to((source / "images" / name).resolve())
    old = [image for name, image in model.images.items() if name in names and name not in new]
    write_model(folder / "model", model.cameras, old)
    return {name: model.images[name].pose for name in new}


def poses_of(folder: pathlib.Path) -> dict[str, dict]:
    return {name.split("/", 1)[1]: result for name, result in read_results(folder / RESULTS).items()}


def measure(results: dict[str, dict], truth: dict[str, Pose], size: float) -> dict:
    """Returns errors of the localized photos; `size` of the scene."""
    position, angle, sigma, wrong = [], [], [], []
    for name, result in results.items():
        pose = to_pose(result["cam_from_world"]) if result["status"] == "LOCALIZED" else None
        if pose is None:
            continue
        error = pose.cam_in_world - truth[name].cam_in_world
        covariance = np.array(result["position_covariance"])
        position.append(np.linalg.norm(error))
        angle.append(np.degrees(Rotation.from_matrix(pose.rotation @ truth[name].rotation.T).magnitude()))
        sigma.append(np.sqrt(error @ np.linalg.solve(covariance, error) / 3))
        wrong.append(sigma[-1] > MAX_RIGHT_SIGMA and position[-1] > MAX_RIGHT_RATIO * size)
    return {"position": position, "angle": angle, "sigma": sigma, "wrong": wrong}


def free_errors(colmap: pathlib.Path, both: pathlib.Path, truth: dict[str, Pose], names: list[str], work: pathlib.Path):
    """Adjusts the model of both epochs freely, and moves it to the true database positions."""
    work.mkdir(exist_ok=True)
    given = read_model(both).images
    words = [colmap, "bundle_adjuster", "--input_path", both, "--output_path", work]
    subprocess.run(list(map(str, words)), check=True, capture_output=True)
    free = read_model(work).images
    old = [name for name in given if name.startswith("database/")]
    a = np.array([free[name].pose.cam_in_world for name in old])
    b = np.array([given[name].pose.cam_in_world for name in old])
    u, s, vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    flip = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ flip @ vt
    scale = np.trace(np.diag(s) @ flip) / ((a - a.mean(0)) ** 2).sum()
    move = lambda x: scale * rotation @ (x - a.mean(0)) + b.mean(0)  # noqa: E731
    return [
        float(np.linalg.norm(move(free[f"query/{name}"].pose.cam_in_world) - truth[name].cam_in_world))
        for name in names
        if f"query/{name}" in free
    ]


def row(label: str, found: dict, num: int, seconds: float | None) -> str:
    e = 1000 * np.array(found["position"])
    text = f"{seconds:.0f}" if seconds is not None else ""
    rms = np.sqrt(np.mean(np.square(found["sigma"]))) if found["sigma"] else float("nan")
    angle = np.median(found["angle"]) if found["angle"] else float("nan")
    wrong = sum(found["wrong"])
    return (
        f"| {label} | {len(e)} of {num} | {np.median(e):.2f} | {e.mean():.2f} | {np.percentile(e, 90):.2f} "
        f"| {angle:.4f} | {rms:.2f} | {wrong} | {text} |"
    )


def run_scene(name: str, options: argparse.Namespace) -> list[str]:
    folder = (options.work_path / pathlib.Path(name).name).resolve()
    is_new = not (folder / "truth.json").exists()
    if is_new:
        shutil.rmtree(folder, ignore_errors=True)
        if name in ("courtyard", "half", "survey", "room"):
            truth = rendered(name, folder, options.seed, options.num_photos)
        else:
            truth = split(pathlib.Path(name), folder, options.split == "blocks")
        poses = {key: [*pose.qvec.tolist(), *pose.tvec.tolist()] for key, pose in truth.items()}
        (folder / "truth.json").write_text(json.dumps(poses))
    poses = json.loads((folder / "truth.json").read_text())
    truth = {key: Pose(np.array(values[:4]), np.array(values[4:])) for key, values in poses.items()}
    words = ["--database_images", folder / "database", "--poses", folder / "model", "--queries", folder / "new"]
    words += ["--accept_poses", "--output", folder / "run", *options.more]
    seconds = {}
    for label, more in (("alone", ()), ("together", ("--epoch", "both"))):
        if label == "alone" and not options.times:
            continue
        shutil.rmtree(folder / "run", ignore_errors=True)
        begin = time.monotonic()
        command = [sys.executable, "-m", "colmap_lazyloc", "run", *words, *more]
        subprocess.run(list(map(str, command)), check=True, capture_output=not options.verbose)
        seconds[label] = time.monotonic() - begin
    given = read_model(folder / "model").images
    after = read_model(folder / "run/epoch/model").images
    same = all(after[f"database/{key}"].pose.bits() == image.pose.bits() for key, image in given.items())
    centres = np.array([image.pose.cam_in_world for image in given.values()])
    size = float(np.linalg.norm(np.ptp(centres, axis=0)))
    alone, together = poses_of(folder / "run/localized"), poses_of(folder / "run/epoch")
    num = len(truth)
    hung = {key: value for key, value in together.items() if value.get("epoch", {}).get("hangs_on") == "new_photos"}
    rest = {key: value for key, value in together.items() if key not in hung}
    lines = [row(f"{folder.name}: alone", measure(alone, truth, size), num, seconds.get("alone"))]
    lines.append(row("together, seen by the database", measure(rest, truth, size), num, seconds["together"]))
    if any(value["status"] == "LOCALIZED" for value in hung.values()):
        lines.append(row("together, hanging on others", measure(hung, truth, size), num, None))
    names = [key for key, value in rest.items() if value["status"] == "LOCALIZED"]
    free = free_errors(find_program(), folder / "run/epoch/model", truth, names, folder / "free")
    lines.append(row("free", {"position": free, "angle": [], "sigma": [], "wrong": []}, num, None))
    lines.append(f"database poses {'keep every bit' if same else 'HAVE CHANGED'}")
    command = [sys.executable, "-m", "colmap_lazyloc", "changes", folder / "run"]
    found = subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True)
    return lines + found.stdout.splitlines()


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work_path", type=pathlib.Path, required=True)
    parser.add_argument("--scene", nargs="+", default=["courtyard", "half", "survey"])
    parser.add_argument("--split", choices=("every_second", "blocks"), default="every_second")
    parser.add_argument("--num_photos", type=int, default=50, help="of a rendered second epoch")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--times", action="store_true", help="also run without --epoch, for its time")
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--more", nargs=argparse.REMAINDER, default=[], help="further options of lazyloc run")
    options = parser.parse_args(arguments)
    print("| scene | localized | median mm | mean mm | 90 % mm | median ° | sigma | wrong | seconds |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in options.scene:
        print("\n".join(run_scene(name, options)), flush=True)
    return 0

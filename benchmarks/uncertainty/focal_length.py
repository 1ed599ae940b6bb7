"""Localizes the queries of scenes with focal lengths that are too long, and prints a Markdown table.

Each query's focal length is multiplied by factors: as given in a query list, and as EXIF's in a copy of the database
(principal point at the centre, prior flag set, relative poses of the pairs forgotten), beside the scene's cameras and
beside cameras of another size, which no photo shares ("EXIF alone"). The copy's keypoints are shifted as if all
principal points were at the centre, so that only the focal length is wrong, and the pixels' aspect ratio where that of
the scene is not 1. Scenes with distortion have no EXIF-like input. Columns: statuses; median position error; median
standard deviation of the position; median and largest error in standard deviations of its direction.

  python -m benchmarks uncertainty focal_length --data_path DATA [--scenes SCENE...] [--factors FACTOR...]
"""

import argparse
import collections
import dataclasses
import pathlib
import shutil
import tempfile

import numpy as np

from benchmarks.localization.scenes import find_scenes, load_scene
from benchmarks.uncertainty import localizer
from colmap_lazyloc import database
from colmap_lazyloc.errors import command
from colmap_lazyloc.model import write_model
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import pose_of

FACTORS = 1, 1.02, 1.05, 1.1, 1.2, 1.5
UNCALIBRATED = 3  # COLMAP's configuration of a two-view geometry


def write_given(scene, factor, folder):
    """Returns the path of the database, and for each query its line in a query list with longer focal lengths."""
    del folder
    lines = {}
    for name in scene.query_names:
        camera = scene.camera(name)
        fx, fy, *others = camera.params
        longer = dataclasses.replace(camera, params=(factor * fx, factor * fy, *others))
        lines[name] = f"{name} {longer.text()}\n"
    return scene.database_path, lines


def offset_of_centre(camera):
    return np.array([camera.width / 2, camera.height / 2]) - camera.params[2:4]


def centred(camera):
    """Returns the pinhole camera with the principal point at the centre."""
    return dataclasses.replace(camera, params=(*camera.params[:2], camera.width / 2, camera.height / 2))


def of_another_size(camera):
    """Returns the centred pinhole camera as if of images that are 2 pixels wider."""
    return dataclasses.replace(centred(camera), width=camera.width + 2)


def shift_keypoints(connection, image_id, offset):
    row = connection.execute("SELECT rows, cols, data FROM keypoints WHERE image_id = ?", (image_id,)).fetchone()
    if row is None or not row[0]:
        return
    keypoints = np.frombuffer(row[2], np.float32).reshape(row[:2]).copy()
    keypoints[:, :2] += offset
    connection.execute("UPDATE keypoints SET data = ? WHERE image_id = ?", (keypoints.tobytes(), image_id))


def write_exif(scene, factor, folder):
    """Copies the database and gives its queries cameras as if from EXIF; returns its path, and the queries' lines."""
    path = folder / "database.db"
    shutil.copyfile(scene.database_path, path)
    path.chmod(0o644)
    connection = database.connect(path, "rw")
    ids = dict(connection.execute("SELECT name, image_id FROM images"))
    queries = {ids[name] for name in scene.query_names}
    next_id = connection.execute("SELECT MAX(camera_id) + 1 FROM cameras").fetchone()[0]
    for camera_id, name in enumerate(scene.query_names, next_id):
        camera = scene.camera(name)
        focal = factor * np.mean(camera.params[:2])
        params = np.array([focal, focal, camera.width / 2, camera.height / 2]).tobytes()
        connection.execute(
            "INSERT INTO cameras (camera_id, model, width, height, params, prior_focal_length) "
            "VALUES (?, 1, ?, ?, ?, 1)",
            (camera_id, camera.width, camera.height, params),
        )
        connection.execute("UPDATE images SET camera_id = ? WHERE image_id = ?", (camera_id, ids[name]))
    for name, image_id in ids.items():
        shift_keypoints(connection, image_id, offset_of_centre(scene.camera(name)) if name in scene.images else 0)
    for (pair,) in connection.execute("SELECT pair_id FROM two_view_geometries").fetchall():
        if {pair // 2147483647, pair % 2147483647} & queries:
            connection.execute("UPDATE two_view_geometries SET config = ? WHERE pair_id = ?", (UNCALIBRATED, pair))
    connection.commit()
    connection.close()
    return path, {name: f"{name}\n" for name in scene.query_names}


# How the input is written, and what becomes of the model's cameras.
INPUTS = {
    "given": (write_given, lambda camera: camera),
    "EXIF": (write_exif, centred),
    "EXIF alone": (write_exif, of_another_size),
}


def localize(colmap, scene, origin, factor, arguments):
    """Returns the results of the scene's queries.

    In leave-one-out, each query has a run of its own with a model without it, because else its camera would be the
    model's.
    """
    results = {}
    write_input, change = INPUTS[origin]
    cameras = {camera_id: change(camera) for camera_id, camera in scene.cameras.items()}
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        database_path, lines = write_input(scene, factor, folder)
        names = scene.query_names
        for group in [[name] for name in names] if scene.protocol.leave_one_out else [names]:
            known = [scene.images[name] for name in scene.database_names(group[0])]
            (folder / "queries.txt").write_text("".join(lines[name] for name in group))
            results |= localizer.localize(
                colmap,
                database_path,
                write_model(folder / "model", cameras, known),
                folder / "output",
                "--query_list_path",
                folder / "queries.txt",
                "--LazyLocalizer.Advanced.use_rigs",
                0,
                *arguments,
            )
    return results


def errors_of(scene, results):
    """Returns rows: position error, its standard deviation, error in standard deviations (localized queries only)."""
    rows = []
    for name, result in results.items():
        if result["status"] != "LOCALIZED":
            continue
        pose = pose_of(result)
        error, sigmas = localizer.position_error(pose, result["covariance"], scene.true_pose(name).cam_in_world)
        stddev = np.sqrt(np.trace(localizer.position_covariance(pose, result["covariance"])))
        rows.append((error, stddev, sigmas))
    return np.array(rows).reshape(-1, 3)


def print_scene(colmap, scene, factors, arguments):
    for origin in INPUTS:
        if origin != "given" and any(camera.model != "PINHOLE" for camera in scene.cameras.values()):
            continue  # keypoints would have to be undistorted
        for factor in factors:
            results = localize(colmap, scene, origin, factor, arguments)
            statuses = collections.Counter(result["status"] for result in results.values())
            rows = errors_of(scene, results)
            text = ", ".join(f"`{status}` {count}" for status, count in sorted(statuses.items()))
            figures = "– | – | – | –"
            if len(rows):
                error, stddev, sigmas = np.median(rows, axis=0)
                figures = f"{error:.3g} | {stddev:.3g} | {sigmas:.1f} | {rows[:, 2].max():.1f}"
            print(f"| {scene.name} | {origin} | {factor} | {text} | {figures} |", flush=True)


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data_path", type=pathlib.Path, required=True, help="folder of the scenes")
    parser.add_argument("--scenes", nargs="*", help="names of scenes; default: all")
    parser.add_argument("--factors", type=float, nargs="+", default=FACTORS, help="factors on the focal lengths")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--options", nargs=argparse.REMAINDER, default=[], help="further options of the program")
    arguments = parser.parse_args(arguments)
    print("| scene | input | factor | statuses | median error | median σ | median error / σ | largest |")
    print("|---|---|---|---|---|---|---|---|")
    for name in arguments.scenes or find_scenes(arguments.data_path):
        print_scene(arguments.colmap, load_scene(arguments.data_path / name), arguments.factors, arguments.options)

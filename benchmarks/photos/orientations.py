"""Localizes photos that are stored in each of the eight orientations of EXIF, and compares the poses with upright's.

    python -m benchmarks orientations --help

Every fourth image of a scene is left out of the database. Its middle is a photo twice: as a landscape and as a portrait
photo (3:4). Their size is not that of the image, so that no intrinsics are taken from the database. Each photo is
stored in the orientations 1 to 8, so that a viewer always shows it upright, and is localized with and without given
intrinsics. Each orientation is localized on its own, so that the others do not help. --database_colmap extracts the
features of the database, so that versions of COLMAP can be compared.

Prints a table: how many photos are LOCALIZED; the differences between their poses and those of orientation 1, also
divided by the standard deviations that both state (sum of both covariances); and the errors of the positions. Each cell
has the median and the largest value. A scene is a folder as for benchmarks/localization, with images/ beside the model,
in metres; it is only read. Databases, photos and results are kept in --work_path.
"""

import argparse
import dataclasses
import pathlib

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.localization.environment import describe_environment
from benchmarks.photos import photo_scenes
from benchmarks.photos.oriented_photos import TURNS, stored_camera, upright_pose, write_oriented
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import pose_of

ORIENTATIONS = range(1, 9)
INTRINSICS = {True: "given", False: "estimated"}  # by whether the query list has them
# A model in the folder of ONNX models follows the options of ALIKED.
EXTRACTIONS = {
    "SIFT": ((), None),
    "ALIKED": (
        ("--FeatureExtraction.type", "ALIKED_N16ROT", "--AlikedExtraction.n16rot_model_path"),
        "aliked-n16rot.onnx",
    ),
}


@dataclasses.dataclass(frozen=True)
class Photo:
    """A query: the middle columns of an image of a scene."""

    source: str
    name: str
    width: int


@dataclasses.dataclass
class OrientedScene:
    """A scene, and how its photos are localized in each orientation."""

    fold: photo_scenes.Fold
    options: list[object]  # of lazy_localizer

    def photos(self) -> list[Photo]:
        photos = []
        for name in self.fold.query_names:
            camera = self.fold.scene.camera(name)
            photos.append(Photo(name, f"landscape/{name}.jpg", camera.width * 15 // 16))
            photos.append(Photo(name, f"portrait/{name}.jpg", camera.height * 3 // 4))
        return photos

    def localize(self, orientation: int, *, is_given: bool) -> dict[str, dict]:
        """Localizes all photos as they are stored in this orientation; returns the results by name."""
        scene, image_path = self.fold.scene, self.fold.work_path / f"stored_{orientation}"
        # The program finds the images of the database below the folder of the photos.
        for name in self.fold.database_names:
            path = image_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                path.symlink_to((scene.path / "images" / name).resolve())
        lines = []
        for photo in self.photos():
            path = image_path / photo.name
            write_oriented(path, scene.path / "images" / photo.source, orientation, photo.width)
            camera = ""
            if is_given and orientation in TURNS:
                camera = stored_camera(scene.camera(photo.source), orientation, photo.width).text()
            lines.append(f"{photo.name} {camera}\n")
        self.fold.query_list_path.write_text("".join(lines))
        return self.fold.localize(
            self.fold.photo_path,
            f"orientation_{orientation}",
            "--image_path",
            image_path,
            "--retrieval_index_path",
            self.fold.index_path,
            *self.options,
        )

    def compare(self, records: dict[str, dict], orientation: int, upright: dict[str, dict]) -> np.ndarray:
        """Returns a row for each photo with a pose: the differences of position in mm and of rotation in degrees to
        the upright photo's pose, both in standard deviations, and the error of the position in mm."""
        rows = []
        for photo in self.photos():
            pose, reference = pose_of(records[photo.name]), pose_of(upright[photo.name])
            if pose is None:
                continue
            pose = upright_pose(pose, orientation)
            error = pose.errors(self.fold.scene.true_pose(photo.source))[0]
            differences = [np.nan] * 4
            if reference is not None:
                distance, angle_deg = pose.errors(reference)
                # Of world_from_cam: its rotation is about the axes of the model, which do not turn with the photo.
                covariance = sum(np.array(each[photo.name]["pose_covariance_in_map"]) for each in (records, upright))
                moved = pose.cam_in_world - reference.cam_in_world
                turned = Rotation.from_matrix(pose.rotation.T @ reference.rotation).as_rotvec()
                deviations = [
                    np.sqrt(vector @ np.linalg.solve(block, vector) / 3)
                    for vector, block in ((moved, covariance[:3, :3]), (turned, covariance[3:, 3:]))
                ]
                differences = [1000 * distance, angle_deg, *deviations]
            rows.append([*differences, 1000 * error])
        return np.array(rows).reshape(-1, 5)


def summary(values: np.ndarray, digits: int) -> str:
    """Returns the median and the largest value."""
    values = values[np.isfinite(values)]
    return f"{np.median(values):.{digits}f}, {np.max(values):.{digits}f}" if values.size else "-"


@command
def main(arguments=None):
    options = parse(arguments)
    print(*describe_environment(), "", sep="\n")
    extraction, model = EXTRACTIONS[options.features]
    if model:
        extraction = (*extraction, (options.onnx_path / model).resolve())
    scenes = []
    for path in options.scene_path:
        fold = photo_scenes.make_fold(
            path, 0, options.work_path, options.database_colmap, is_matched=False, extraction=extraction
        )
        fold = dataclasses.replace(fold, colmap=options.colmap)
        scenes.append(OrientedScene(fold, ["--onnx_path", options.onnx_path] if model else []))
    heads = "difference of position mm", "of rotation °", "of position, deviations", "of rotation, deviations"
    print(
        f"| intrinsics | orientation | localized | {' | '.join(heads)} | error of position mm |",
        "|---" * 8 + "|",
        sep="\n",
    )
    for is_given, label in INTRINSICS.items():
        upright: list[dict[str, dict]] = []
        for orientation in ORIENTATIONS:
            results = [scene.localize(orientation, is_given=is_given) for scene in scenes]
            upright = upright or results
            statuses = [record["status"] for records in results for record in records.values()]
            count = f"{statuses.count('LOCALIZED')} of {len(statuses)}"
            cells = []
            if orientation in TURNS:
                table = np.concatenate(
                    [
                        scene.compare(records, orientation, reference)
                        for scene, records, reference in zip(scenes, results, upright, strict=True)
                    ]
                )
                cells = [summary(table[:, column], digits) for column, digits in enumerate((2, 4, 3, 3, 1))]
            else:
                cells = [", ".join(sorted(set(statuses)))] + ["-"] * 4  # no pose fits a mirror image
            print(f"| {label} | {orientation} | {count} | {' | '.join(cells)} |", flush=True)


def parse(arguments) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene_path", type=pathlib.Path, nargs="+", help="folder with images/ and model/ (text)")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--database_colmap", type=pathlib.Path, help="program that extracts features of the database")
    parser.add_argument("--features", choices=EXTRACTIONS, default="SIFT", help="features of the database")
    parser.add_argument("--onnx_path", type=pathlib.Path, help="folder of COLMAP 4's ONNX models, for ALIKED")
    parser.add_argument("--work_path", type=pathlib.Path, required=True, help="folder for databases and results")
    options = parser.parse_args(arguments)
    options.database_colmap = options.database_colmap or options.colmap
    return options

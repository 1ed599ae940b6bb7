"""A few small rendered photos of the demo's courtyard, and a COLMAP database with the features of the posed ones."""

import dataclasses
import pathlib

import cv2
import numpy as np

from colmap_lazyloc import program
from colmap_lazyloc.demo import scene as demo
from colmap_lazyloc.demo.renderer import RayGrid, render
from colmap_lazyloc.model import Camera

CAMERA = Camera("SIMPLE_RADIAL", 480, 360, (400.0, 241.0, 179.0, -0.03))
TARGET = np.array([0.5, 5.0, 1.8])  # of the north wall
DATABASE_CENTRES = [
    (-3.5, -3.0, 1.6),
    (-2.0, -3.6, 1.2),
    (-0.7, -3.2, 2.2),
    (0.6, -3.5, 1.5),
    (2.0, -3.1, 2.0),
    (3.4, -3.4, 1.3),
]
QUERY_CENTRES = [(-1.4, -2.8, 1.7), (1.3, -3.8, 1.8)]
SIFT = ["--SiftExtraction.max_num_features", "1500", "--SiftExtraction.first_octave", "0"]


@dataclasses.dataclass
class PhotoScene:
    folder: pathlib.Path
    poses: dict  # by name

    image_path = property(lambda self: self.folder / "images")
    database_path = property(lambda self: self.folder / "database.db")
    model_path = property(lambda self: self.folder / "model")
    query_names = property(lambda self: sorted(name for name in self.poses if name.startswith("query")))
    database_names = property(lambda self: sorted(name for name in self.poses if name.startswith("database")))
    camera_words = CAMERA.text()

    def arguments(self, queries, *more):
        return [
            "--database_path",
            self.database_path,
            "--input_path",
            self.model_path,
            "--image_path",
            self.image_path,
            "--query_list_path",
            queries,
            *SIFT,
            *more,
        ]

    def write_queries(self, path, names=None, with_camera=True):
        words = f" {self.camera_words}" if with_camera else ""
        path.write_text("".join(f"{name}{words}\n" for name in names or self.query_names))
        return path

    def assert_localized(self, run, names=None, max_position_error=0.05):
        """Checks the poses of these queries, or of all; the bounds suit a courtyard of 20 m."""
        assert run.exit_code == 0, run.stderr
        for name in names or self.query_names:
            assert run.statuses[name] == "LOCALIZED", run.results[name]["reason"]
            position_error, rotation_error_deg = run.poses[name].errors(self.poses[name])
            assert position_error < max_position_error and rotation_error_deg < 0.3, name


def match_exhaustively(colmap, database_path):
    program.run_colmap(
        colmap,
        "exhaustive_matcher",
        "--database_path",
        database_path,
        program.gpu_option(colmap, "exhaustive_matcher"),
        0,
    )


def extract_features(colmap, database_path, image_path, names):
    program.extract_features(colmap, database_path, image_path, names, CAMERA, *SIFT)


def build_courtyard():
    return demo.build_scene(seed=0, texels_per_m=80)


def look_at_target(centre, roll_deg):
    return demo.upright_pose(np.array(centre), TARGET, roll_deg)


def take_photo(rectangles, rays, pose, seed):
    return demo.photograph(render(rectangles, rays, pose, demo.sky), np.random.default_rng(seed))


def make_photo_scene(folder, colmap):
    rectangles = build_courtyard()
    rays = RayGrid(CAMERA)
    views = []
    for prefix, centres in (("database", DATABASE_CENTRES), ("query", QUERY_CENTRES)):
        for index, centre in enumerate(centres):
            pose = look_at_target(centre, roll_deg=2.0 * index - 3)
            views.append(demo.View(f"{prefix}/{index}.png", CAMERA, pose))
    (folder / "images" / "database").mkdir(parents=True)
    (folder / "images" / "query").mkdir()
    for index, view in enumerate(views):
        photo = take_photo(rectangles, rays, view.pose, seed=index)
        assert cv2.imwrite(str(folder / "images" / view.name), photo)
    scene = PhotoScene(folder, {view.name: view.pose for view in views})
    demo.write_database_model(folder / "model", views[: len(DATABASE_CENTRES)])
    extract_features(colmap, scene.database_path, scene.image_path, scene.database_names)
    return scene

"""Renders a drone's survey of the demo's courtyard: photos that look down, in geographic coordinates.

Writes below the output folder:
  photos/NAME.jpg, poses.csv     photos of the survey, and their poses as a photogrammetry program exports them
  new/NAME.jpg                   later photos, the queries, with GPS in EXIF
  camera.txt                     `MODEL width height params...`
  control_points.csv             points on the ground and on boxes: latitude, longitude, height
  marks.csv                      where the control points are in the photos, in pixels
"""

import csv
import pathlib

import numpy as np
from PIL import Image
from PIL.ExifTags import GPS, IFD

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.demo.scene import BOXES, View, build_scene, write_images
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.poses import Pose, look_at
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

CAMERA = Camera("SIMPLE_RADIAL", 640, 480, (500.0, 320.0, 240.0, -0.02))
ORIGIN = GeoOrigin(47.3769, 8.5417, 408.0)
HEIGHT = 11.0  # of the flight, above the ground
POSE_NOISE_M, MARK_NOISE_PX = 0.01, 0.3
GPS_NOISE_M = np.array([2.0, 2.0, 4.0])


def make_survey(output: pathlib.Path, seed: int) -> None:
    rng = np.random.default_rng([seed, 20])
    survey, new = make_views(rng)
    rectangles = build_scene(seed, texels_per_m=110)
    write_images(output / "photos", rectangles, survey, seed, stream=20)
    write_images(output / "new", rectangles, new, seed, stream=21)
    _write_poses(output / "poses.csv", survey, rng)
    for view in new:
        write_gps(output / "new" / view.name, view.pose.cam_in_world + GPS_NOISE_M * rng.standard_normal(3))
    _write_control_points(output, [*new, *survey], rng)
    (output / "camera.txt").write_text(f"{CAMERA.text()}\n")


def make_views(rng: np.random.Generator) -> tuple[list[View], list[View]]:
    """Makes the views of the survey, and those of the later photos."""
    grid = [(x, y) for y in (-3.0, 0.0, 3.0) for x in (-5.0, -2.5, 0.0, 2.5, 5.0)]
    later = [(-3.6, -1.4), (-1.1, 1.6), (1.4, -1.2), (3.7, 1.3)]
    return _views(rng, grid, "DJI_00", spread=0.3), _views(rng, later, "DJI_01", spread=0.5)


def _views(rng: np.random.Generator, places: list[tuple[float, float]], prefix: str, spread: float) -> list[View]:
    """Makes views that look down, at most a few degrees off, in the direction of the flight."""
    views = []
    for index, place in enumerate(places):
        centre = np.array([*place, HEIGHT]) + spread * rng.uniform(-1, 1, 3)
        target = np.array([*(centre[:2] + rng.uniform(-0.6, 0.6, 2)), 0.0])
        rotation = look_at(centre, target, (0, -1, 0), roll_deg=float(rng.uniform(-5, 5)))
        views.append(View(f"{prefix}{index:02}.jpg", CAMERA, Pose.from_centre(rotation, centre)))
    return views


def _write_poses(path: pathlib.Path, views: list[View], rng: np.random.Generator) -> None:
    centres = np.array([view.pose.cam_in_world for view in views])
    places = ORIGIN.to_geodetic(centres + POSE_NOISE_M * rng.standard_normal(centres.shape))
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "latitude", "longitude", "altitude", "qw", "qx", "qy", "qz"])
        for view, (latitude, longitude, height) in zip(views, places):
            w, x, y, z = view.pose.qvec
            writer.writerow([view.name, f"{latitude:.9f}", f"{longitude:.9f}", f"{height:.4f}", w, -x, -y, -z])


def write_gps(path: pathlib.Path, position: Floats) -> None:
    """Writes a position into the EXIF of a photo, without compressing it again."""
    latitude, longitude, height = ORIGIN.to_geodetic(position[None])[0]
    exif = Image.Exif()
    gps: dict[int, object] = {
        GPS.GPSLatitudeRef: "N",
        GPS.GPSLatitude: _degrees(latitude),
        GPS.GPSLongitudeRef: "E",
        GPS.GPSLongitude: _degrees(longitude),
        GPS.GPSAltitudeRef: b"\0",
        GPS.GPSAltitude: round(float(height), 2),
    }
    exif.get_ifd(IFD.GPSInfo).update(gps)
    block = exif.tobytes()
    photo = path.read_bytes()
    path.write_bytes(photo[:2] + b"\xff\xe1" + (len(block) + 2).to_bytes(2, "big") + block + photo[2:])


def _degrees(value: float) -> tuple[float, float, float]:
    minutes, seconds = divmod(round(value * 3600, 4), 60)
    degrees, minutes = divmod(minutes, 60)
    return degrees, minutes, round(seconds, 4)


def _write_control_points(output: pathlib.Path, views: list[View], rng: np.random.Generator) -> None:
    ground = [(-4.0, -3.0), (-2.9, 1.2), (-0.6, -2.6), (3.4, -2.0), (4.4, 1.4), (1.2, 2.4)]
    tops = [(*box.centre[:2], box.centre[2] + box.size[2]) for box in BOXES[3:6]]
    points = np.array([*((x, y, 0.0) for x, y in ground), *tops])
    places = ORIGIN.to_geodetic(points)
    camera = to_pycolmap_camera(CAMERA)
    with (output / "control_points.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["point", "latitude", "longitude", "height"])
        for index, place in enumerate(places):
            writer.writerow([f"P{index + 1}", *(f"{value:.9f}" for value in place)])
    with (output / "marks.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["photo", "point", "x", "y"])
        for view in views:
            for index, pixel in enumerate(np.asarray(camera.img_from_cam(view.pose(points)))):
                if np.all(pixel > 20) and pixel[0] < CAMERA.width - 20 and pixel[1] < CAMERA.height - 20:
                    x, y = pixel + MARK_NOISE_PX * rng.standard_normal(2)
                    writer.writerow([view.name, f"P{index + 1}", f"{x:.2f}", f"{y:.2f}"])

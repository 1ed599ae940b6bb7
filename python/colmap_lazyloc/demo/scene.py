"""Makes the demo scene: photos of a courtyard with exactly known poses and intrinsics."""

import dataclasses
import hashlib
import json
import pathlib
from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
from numpy.random import Generator
from scipy.spatial.transform import Rotation

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.demo import textures
from colmap_lazyloc.demo.renderer import RayGrid, Rectangle, render
from colmap_lazyloc.demo.textures import Colour
from colmap_lazyloc.model import Camera, Image, write_model
from colmap_lazyloc.poses import Pose, look_at, write_poses
from colmap_lazyloc.progress import ProgressBar

# The courtyard in metres: x east, y north, z up, the origin on the ground in the middle.
SIZE = np.array([16.0, 12.0, 6.0])
Texture = Callable[[Generator, Sequence[float], float, Colour], Array]  # paints a surface of a size

SUN = np.array([0.45, -0.55, 0.70])
WALK_CENTRE, WALK_RADII = np.array([0.0, -0.6]), np.array([5.6, 3.3])
CLEARANCE = 0.9  # minimum distance of a camera from the boxes

DATABASE_CAMERA = Camera("OPENCV", 800, 600, (641.3, 643.1, 404.6, 296.2, -0.118, 0.041, 0.0011, -0.0007))
QUERY_CAMERA = Camera("RADIAL", 840, 560, (583.7, 415.2, 284.9, -0.083, 0.021))


@dataclasses.dataclass(frozen=True)
class Box:
    """A box that stands in the courtyard; `texture` paints its sides and its top."""

    centre: tuple[float, float, float]  # the centre of the base
    size: tuple[float, float, float]
    yaw_deg: float
    texture: Texture
    colour: Colour

    def rectangles(self, rng: Generator, texels_per_m: float) -> Iterator[Rectangle]:
        axes = Rotation.from_euler("z", self.yaw_deg, degrees=True).as_matrix().T
        half = np.array(self.size) / 2
        centre = np.array(self.centre) + [0, 0, half[2]]
        up = np.array([0.0, 0.0, 1.0])
        for outward, width, depth in ((-axes[1], 0, 1), (axes[0], 1, 0), (axes[1], 0, 1), (-axes[0], 1, 0)):
            right = np.cross(up, outward) * self.size[width]
            corner = centre + outward * half[depth] - right / 2 + up * half[2]
            yield _paint(rng, corner, right, -up * self.size[2], self.texture, texels_per_m, self.colour)
        right, down = axes[0] * self.size[0], -axes[1] * self.size[1]
        corner = centre + up * half[2] - right / 2 - down / 2
        yield _paint(rng, corner, right, down, self.texture, texels_per_m, self.colour)

    def distance(self, position: Array) -> float:
        """Returns the distance from the outline of the base, on the ground plan."""
        offset = Rotation.from_euler("z", -self.yaw_deg, degrees=True).apply([*(position[:2] - self.centre[:2]), 0])
        return float(np.linalg.norm(np.maximum(np.abs(offset[:2]) - np.array(self.size[:2]) / 2, 0)))


BOXES = (
    Box((2.9, 5.0, 0), (3.4, 2.0, 6.0), 0, textures.facade, (140, 165, 190)),  # a bay of the north wall
    Box((-5.2, 4.0, 0), (0.7, 0.7, 4.2), 0, textures.stone, (165, 170, 175)),
    Box((-2.4, 4.1, 0), (0.6, 0.6, 4.2), 8, textures.stone, (150, 165, 170)),
    Box((0.1, 0.2, 0), (0.9, 0.9, 2.3), 33, textures.stone, (120, 150, 150)),
    Box((-1.5, -0.9, 0), (1.1, 0.8, 0.8), -20, textures.planks, (70, 115, 160)),
    Box((1.9, -1.0, 0), (1.2, 1.0, 1.0), 15, textures.planks, (60, 100, 150)),
    Box((1.8, -0.95, 1.0), (0.7, 0.7, 0.6), 50, textures.planks, (80, 130, 165)),
    Box((6.9, 3.4, 0), (1.1, 1.4, 1.3), 5, textures.planks, (75, 120, 150)),
    Box((-7.0, -4.6, 0), (1.0, 1.2, 1.5), -12, textures.planks, (65, 105, 140)),
)


@dataclasses.dataclass(frozen=True)
class View:
    name: str
    camera: Camera
    pose: Pose


def _paint(
    rng: Generator, corner: Array, right: Array, down: Array, texture: Texture, texels_per_m: float, colour: Colour
) -> Rectangle:
    """Makes a textured rectangle whose brightness depends on its direction to the sun."""
    size = float(np.linalg.norm(right)), float(np.linalg.norm(down))
    outward = np.cross(down, right) / (size[0] * size[1])
    light = 0.62 + 0.45 * max(0.0, float(outward @ SUN / np.linalg.norm(SUN)))
    picture = texture(rng, size, texels_per_m, colour)
    return Rectangle(corner, right, down, cv2.convertScaleAbs(picture, alpha=light))


def build_scene(seed: int, texels_per_m: float = 220) -> list[Rectangle]:
    rng = np.random.default_rng([seed, 0])
    x, y, top = SIZE[0] / 2, SIZE[1] / 2, SIZE[2]
    walls = (  # upper-left corner as seen from inside, direction to the right, height, colour
        ((-x, y), (SIZE[0], 0), top, (150, 175, 200)),
        ((x, y), (0, -SIZE[1]), 0.9 * top, (120, 140, 185)),
        ((x, -y), (-SIZE[0], 0), 0.65 * top, (165, 170, 160)),
        ((-x, -y), (0, SIZE[1]), 0.8 * top, (135, 165, 165)),
    )
    rectangles = [
        _paint(
            rng,
            np.array([*corner, height]),
            np.array([*right, 0.0]),
            np.array([0.0, 0.0, -height]),
            textures.facade,
            texels_per_m,
            colour,
        )
        for corner, right, height, colour in walls
    ]
    rectangles.append(
        _paint(
            rng,
            np.array([-x, y, 0.0]),
            np.array([SIZE[0], 0.0, 0.0]),
            np.array([0.0, -SIZE[1], 0.0]),
            textures.paving,
            texels_per_m,
            (145, 150, 155),
        )
    )
    for box in BOXES:
        rectangles.extend(box.rectangles(rng, texels_per_m))
    return rectangles


def sky(directions: Array) -> Array:
    elevation = np.clip(directions[:, 2:] / np.linalg.norm(directions, axis=1, keepdims=True), 0, 1)
    colours: Array = np.array([225, 215, 205]) * (1 - elevation) + np.array([215, 165, 110]) * elevation
    return colours.astype(np.float32)


def upright_pose(cam_in_world: Array, target: Array, roll_deg: float) -> Pose:
    """Returns the pose of a camera that looks at a target and is turned by `roll_deg` from upright."""
    return Pose.from_centre(look_at(cam_in_world, target, (0, 0, -1), roll_deg), cam_in_world)


def _random_pose(
    rng: Generator,
    angle: float,
    radius_ratio: tuple[float, float],
    heights: tuple[float, float],
    turn_deg: float,
    roll_deg: float,
) -> Pose:
    """Draws a pose near the point of the walk at `angle`, facing the far side of the courtyard, outside all boxes."""
    while True:
        radius = rng.uniform(*radius_ratio)
        ground = WALK_CENTRE + radius * WALK_RADII * [np.cos(angle), np.sin(angle)] + rng.normal(0, 0.15, 2)
        position = np.array([*ground, rng.uniform(*heights)])
        if min(box.distance(position) for box in BOXES) > CLEARANCE:
            break
    heading = angle + np.pi + np.radians(rng.uniform(-turn_deg, turn_deg))
    target = position + 7 * np.array([np.cos(heading), np.sin(heading), 0])
    target[2] = rng.uniform(0.9, 2.7)
    return upright_pose(position, target, rng.normal(0, roll_deg))


def database_views(seed: int, count: int) -> list[View]:
    """Makes views on a walk around the courtyard, with the camera at chest height, eye height or held high."""
    rng = np.random.default_rng([seed, 1])
    heights = ((1.1, 1.25), (1.6, 1.75), (2.3, 2.5))
    views = []
    for index in range(count):
        angle = 2 * np.pi * index / count
        pose = _random_pose(rng, angle, (0.95, 1.05), heights[index % 3], turn_deg=40, roll_deg=1.5)
        views.append(View(f"database/{index:03}.jpg", DATABASE_CAMERA, pose))
    return views


def query_views(seed: int, count: int) -> list[View]:
    """Makes views from beside, above and below the walk, with larger tilts."""
    rng = np.random.default_rng([seed, 2])
    views = []
    for index in range(count):
        angle = rng.uniform(0, 2 * np.pi)
        pose = _random_pose(rng, angle, (0.65, 1.15), (0.8, 3.3), turn_deg=55, roll_deg=5)
        views.append(View(f"query/{index:02}.jpg", QUERY_CAMERA, pose))
    return views


def photograph(picture: Array, rng: Generator) -> Array:
    """Simulates a camera: slight blur, random exposure and white balance, sensor noise."""
    blurred = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 0.8))
    exposure = np.exp(rng.normal(0, 0.13)) * np.exp(rng.normal(0, 0.03, 3))
    noise = rng.uniform(1.5, 3.5) * rng.standard_normal(picture.shape, np.float32)
    photo: Array = np.clip(np.round(blurred * exposure.astype(np.float32) + noise), 0, 255)
    return photo.astype(np.uint8)


def write_images(folder: pathlib.Path, rectangles: list[Rectangle], views: list[View], seed: int, stream: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for stale in folder.glob("[0-9]*.jpg"):
        stale.unlink()
    rays = RayGrid(views[0].camera)
    with ProgressBar(f"rendering photos into {folder}", len(views), "photos") as bar:
        for index, view in enumerate(views):
            picture = render(rectangles, rays, view.pose, sky)
            photo = photograph(picture, np.random.default_rng([seed, stream, index]))
            path = folder / pathlib.Path(view.name).name
            if not cv2.imwrite(str(path), photo, [cv2.IMWRITE_JPEG_QUALITY, 95]):
                raise OSError(f"{path}: cannot be written")
            bar.show(index + 1, len(views), "photos")


def write_database_model(folder: pathlib.Path, views: list[View]) -> None:
    """Writes a COLMAP text model of views with one camera."""
    images = [Image(view.name, 1, view.pose, image_id) for image_id, view in enumerate(views, start=1)]
    write_model(folder, {1: views[0].camera}, images)


def write_queries(output: pathlib.Path, views: list[View]) -> None:
    (output / "queries_with_intrinsics.txt").write_text(
        "".join(f"{view.name} {view.camera.text()}\n" for view in views)
    )
    write_poses(output / "ground_truth" / "poses.txt", {view.name: view.pose for view in views})


def code_hash() -> str:
    code = hashlib.sha256()
    for name in ("scene.py", "renderer.py", "textures.py"):
        code.update(pathlib.Path(__file__).with_name(name).read_bytes())
    return code.hexdigest()


def make_scene(output: pathlib.Path, seed: int, num_database_images: int, num_query_images: int) -> bool:
    """Renders the scene; returns False if it already existed."""
    description = {
        "size_m": SIZE.tolist(),
        "diagonal_m": float(np.linalg.norm(SIZE)),
        "seed": seed,
        "num_database_images": num_database_images,
        "num_query_images": num_query_images,
        "code_sha256": code_hash(),
    }
    scene_path = output / "scene.json"
    if scene_path.exists() and scene_path.read_text() == _as_json(description):
        return False
    output.mkdir(parents=True, exist_ok=True)
    scene_path.unlink(missing_ok=True)
    rectangles = build_scene(seed)
    database, queries = database_views(seed, num_database_images), query_views(seed, num_query_images)
    write_images(output / "images" / "database", rectangles, database, seed, stream=3)
    write_images(output / "images" / "query", rectangles, queries, seed, stream=4)
    write_database_model(output / "database_model", database)
    write_queries(output, queries)
    scene_path.write_text(_as_json(description))
    return True


def _as_json(description: dict[str, object]) -> str:
    return json.dumps(description, indent=2) + "\n"

"""The scenes: a COLMAP text model with true poses, a COLMAP database, and who is localized against whom."""

import dataclasses
import functools
import json
import pathlib

import numpy as np

from geometry import Pose


@dataclasses.dataclass(frozen=True)
class Protocol:
    """Which images of a scene are localized, and against which.

    Candidates are those of queries.txt, or all images without such a file. With `leave_one_out` each is localized
    against all other images of the scene, else against the images that are not candidates. Of the candidates whose
    name starts with `query_prefix`, every `query_step`th is localized.
    """

    leave_one_out: bool = True
    query_prefix: str = ""
    query_step: int = 1


# Of scenes without a protocol.json; those that are not listed here are leave-one-out.
PROTOCOLS = {"kitti1": Protocol(leave_one_out=False, query_prefix="left/", query_step=2)}


@dataclasses.dataclass(frozen=True)
class Camera:
    model: str
    width: int
    height: int
    params: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class PosedImage:
    name: str
    camera_id: int
    cam_from_world: Pose | None  # None: a query whose pose is not known
    line: str  # of images.txt, for models that must hold the same numbers


@dataclasses.dataclass(frozen=True)
class Scene:
    name: str
    path: pathlib.Path
    protocol: Protocol
    cameras: dict[int, Camera]
    images: dict[str, PosedImage]
    candidates: tuple[str, ...]
    true_images: dict[str, PosedImage] | None = None  # where `images` are noisy
    noisy_model_path: pathlib.Path | None = None

    @property
    def database_path(self) -> pathlib.Path:
        return self.path / "database.db"

    @property
    def model_path(self) -> pathlib.Path:
        return self.noisy_model_path or self.path / "model"

    @property
    def query_names(self) -> list[str]:
        names = [name for name in self.candidates if name.startswith(self.protocol.query_prefix)]
        return names[:: self.protocol.query_step]

    @functools.cached_property
    def _fixed_database_names(self) -> list[str]:
        candidates = set(self.candidates)
        return sorted(name for name in self.images if name not in candidates)

    def database_names(self, query_name: str) -> list[str]:
        if self.protocol.leave_one_out:
            return sorted(name for name in self.images if name != query_name and self.images[name].cam_from_world)
        return self._fixed_database_names

    def database_key(self, query_name: str) -> str:
        """Queries with the same key have the same database images."""
        return "without_" + query_name.replace("/", "_") if self.protocol.leave_one_out else "database"

    def camera(self, name: str) -> Camera:
        return self.cameras[self.images[name].camera_id]

    def pose(self, name: str) -> Pose:
        """The methods'; of a database image it may be noisy."""
        return self.images[name].cam_from_world

    def true_pose(self, name: str) -> Pose | None:
        return (self.true_images or self.images)[name].cam_from_world


def read_cameras_text(path: pathlib.Path) -> dict[int, Camera]:
    cameras = {}
    for line in _lines(path):
        if not line:
            continue
        camera_id, model, width, height, *params = line.split()
        cameras[int(camera_id)] = Camera(model, int(width), int(height), tuple(map(float, params)))
    return cameras


def read_images_text(path: pathlib.Path) -> dict[str, PosedImage]:
    images = {}
    # Two lines an image; the second one, its points, may be empty.
    for line in _lines(path)[::2]:
        if not line:
            continue
        values = line.split(maxsplit=9)
        if len(values) != 10:
            raise ValueError(f"{path}: not a line of an image: {line}")
        pose = Pose.from_qvec_tvec(np.array(values[1:5], dtype=float), np.array(values[5:8], dtype=float))
        images[values[9]] = PosedImage(values[9], int(values[8]), pose, line)
    return images


def load_scene(path: pathlib.Path) -> Scene:
    cameras = read_cameras_text(path / "model" / "cameras.txt")
    images = read_images_text(path / "model" / "images.txt")
    queries_path = path / "queries.txt"
    lines = [line for line in _lines(queries_path) if line] if queries_path.exists() else sorted(images)
    candidates = []
    for line in lines:
        name, camera = line, None
        if line not in images:
            name, camera = _query_with_camera(line)
        if name not in images:
            if camera is None:
                raise ValueError(f"{queries_path}: {line} has no pose in {path / 'model'}")
            camera_id = max(cameras, default=0) + 1
            cameras[camera_id] = camera
            images[name] = PosedImage(name, camera_id, None, "")
        candidates.append(name)
    return Scene(path.name, path, _load_protocol(path), cameras, images, tuple(candidates))


def _query_with_camera(line: str) -> tuple[str, Camera | None]:
    """Of `name MODEL width height params...`; no camera where the line is a name."""
    try:
        name, model, width, height, *params = line.split()
        return name, Camera(model, int(width), int(height), tuple(map(float, params)))
    except ValueError:
        return line, None


def _load_protocol(path: pathlib.Path) -> Protocol:
    if (path / "protocol.json").exists():
        return Protocol(**json.loads((path / "protocol.json").read_text()))
    return PROTOCOLS.get(path.name, Protocol())


def camera_text(camera: Camera) -> str:
    """`MODEL width height params...`, exactly."""
    return " ".join([camera.model, str(camera.width), str(camera.height), *map(repr, camera.params)])


def find_scenes(scenes_path: pathlib.Path) -> list[str]:
    return sorted(path.parent.name for path in scenes_path.glob("*/database.db"))


def _lines(path: pathlib.Path) -> list[str]:
    return [line.strip() for line in path.read_text().splitlines() if not line.startswith("#")]

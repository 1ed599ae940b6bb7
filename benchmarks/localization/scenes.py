"""Loads scenes: a COLMAP model with true poses, a COLMAP database, and the protocol that selects the queries."""

import dataclasses
import functools
import json
import pathlib

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera, Image, read_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.queries import read_queries


@dataclasses.dataclass(frozen=True)
class Protocol:
    """Selects the queries of a scene, and the database images of each query.

    Candidates are the images listed in queries.txt, or all images if there is no such file. Every `query_step`th
    candidate whose name starts with `query_prefix` is localized: with `leave_one_out` against all other images of the
    scene, else against the images that are not candidates.
    """

    leave_one_out: bool = True
    query_prefix: str = ""
    query_step: int = 1


# Protocols of scenes without a protocol.json; scenes that are not listed use leave-one-out.
PROTOCOLS = {"kitti1": Protocol(leave_one_out=False, query_prefix="left/", query_step=2)}


@dataclasses.dataclass(frozen=True)
class Scene:
    name: str
    path: pathlib.Path
    protocol: Protocol
    cameras: dict[int, Camera]
    images: dict[str, Image]
    candidates: tuple[str, ...]
    true_images: dict[str, Image] | None = None  # if the poses in `images` are noisy
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
        """Returns a key that is the same for queries with the same database images."""
        return "without_" + query_name.replace("/", "_") if self.protocol.leave_one_out else "database"

    def camera(self, name: str) -> Camera:
        return self.cameras[self.images[name].camera_id]

    def pose(self, name: str) -> Pose:
        """Returns the pose that the methods get; for a database image it may be noisy."""
        return self.images[name].cam_from_world

    def true_pose(self, name: str) -> Pose | None:
        return (self.true_images or self.images)[name].cam_from_world


def load_scene(path: pathlib.Path) -> Scene:
    model = read_model(path / "model")
    cameras, images = dict(model.cameras), dict(model.images)
    queries_path = path / "queries.txt"
    queries = read_queries(queries_path) if queries_path.exists() else dict.fromkeys(sorted(images))
    for name, camera in queries.items():
        if name in images:
            continue
        if camera is None:
            raise InputError(f"{queries_path}: {name} has no pose in {path / 'model'}")
        camera_id = max(cameras, default=0) + 1
        cameras[camera_id] = camera
        images[name] = Image(name, camera_id, None)
    return Scene(path.name, path, _load_protocol(path), cameras, images, tuple(queries))


def _load_protocol(path: pathlib.Path) -> Protocol:
    if (path / "protocol.json").exists():
        return Protocol(**json.loads((path / "protocol.json").read_text()))
    return PROTOCOLS.get(path.name, Protocol())


def find_scenes(scenes_path: pathlib.Path) -> list[str]:
    return sorted(path.parent.name for path in scenes_path.glob("*/database.db"))

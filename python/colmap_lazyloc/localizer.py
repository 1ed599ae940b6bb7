"""Localizes queries in this process; the index, features and caches stay loaded between calls."""

from __future__ import annotations  # help() then has the names of types instead of all that they may be

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc import arrays
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.extension import core
from colmap_lazyloc.inputs import (
    CameraInput,
    GravityPrior,
    Matches,
    ModelInput,
    Options,
    PairInput,
    Photo,
    PoseInput,
    PositionPrior,
    Query,
    QueryT,
)
from colmap_lazyloc.model import is_reconstruction
from colmap_lazyloc.result import Result
from colmap_lazyloc.settings import check_text, to_settings
from colmap_lazyloc.tasks import run_tasks
from colmap_lazyloc.text_files import Path

if TYPE_CHECKING:
    from colmap_lazyloc import _core


Answer = tuple[str, str, NDArray[np.float64], NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]
IDENTITY = np.array([1.0, 0, 0, 0, 0, 0, 0])


class Localizer:
    """Localizes queries against posed images: the images of a COLMAP model, whose poses are known. The results are the
    same as from `colmap lazy_localizer`.

    You may call the methods from several threads. Invalid input raises `InputError`, a subclass of ValueError. A query
    that cannot be localized is not an error: the status of its result gives the reason.
    """

    def __init__(
        self,
        database: Path | None,
        model: Path | ModelInput,
        *,
        index: Path | None = None,
        options: Options | None = None,
    ):
        """Opens a database, read-only, and a model.

        `database`: a COLMAP database; None if you pass features and matches for every query (`localize_matches`).
        `model`: the folder of a COLMAP model, a pycolmap.Reconstruction, or a dict {name: (R, t, camera)} with all
        posed images. R and t are cam_from_world; R is a 3x3 matrix or a quaternion (w, x, y, z). For `camera`, see
        `localize_photo`. Instead of R and t, you can pass one pose, as in `localize_rig`: {name: (pose, camera)}.
        `index`: the file of the retrieval index. The first photo that you localize creates or updates this file.
        `options`: options of the command line by name (see `list_options`), for example {"num_retrieved": 20},
        {"LazyLocalizer": {"num_retrieved": 20}} or {"LazyLocalizer.num_retrieved": 20}.
        """
        given = dict(to_settings({} if options is None else options))
        folder = model if isinstance(model, str | os.PathLike) else None
        if folder is None and not isinstance(model, Mapping) and not is_reconstruction(model):
            raise InputError(
                f"model: must be a folder, a Reconstruction or a dict of images, but is of type {type(model).__name__}"
            )
        paths = {"database_path": database, "retrieval_index_path": index, "input_path": folder}
        for name, path in to_settings({name: path for name, path in paths.items() if path is not None}):
            if name in given:
                raise InputError(f"option {name} is given twice: it is an argument of Localizer, too")
            given[name] = path
        if folder is not None and "input_path" not in given:
            raise InputError("model: the path is empty")
        self._is_leave_one_out = given.get("LazyLocalizer.leave_one_out") == "1"
        self._num_threads = int(given.get("LazyLocalizer.num_threads", -1)) if _is_int(given) else -1
        in_memory = None if isinstance(model, str | os.PathLike) else arrays.to_model(model)
        self._core: _core.Localizer | None = core.Localizer(list(given.items()), in_memory)
        for warning in self._core.warnings():
            warnings.warn(warning, stacklevel=2)

    def close(self) -> None:
        """Closes the database, and frees the memory when all calls in other threads have ended."""
        self._core = None

    def __enter__(self) -> Localizer:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def num_threads(self) -> int:
        """Returns how many queries `localize_all` localizes at the same time: the option LazyLocalizer.num_threads, by
        default the number of cores."""
        return self._num_threads if self._num_threads > 0 else os.cpu_count() or 1

    @property
    def queries(self) -> list[str]:
        """Returns the names of the queries that the options select; by default, all images in the database that have
        no pose in the model."""
        return [name for group in self._open().groups() for name in group]

    def localize(
        self, name: str, *, position: PositionPrior | None = None, gravity: GravityPrior | None = None
    ) -> Result:
        """Localizes one of `queries`, together with all images of its group or of its rig's frame, and returns the
        result of this query.

        `position`: ((x, y, z), uncertainty), the rough position of the camera in the model's coordinates, for example
        from GPS. The uncertainty is one standard deviation, three standard deviations (x, y, z), or a 3x3 covariance.
        `gravity`: ((x, y, z), standard deviation in degrees), the downward direction in the camera's axes (x right, y
        down, z forward). This argument needs the option world_up, the upward direction in the model.

        `position` and `gravity` replace the values in query_position_path and query_gravity_path. A value that
        contradicts the images is not used; `as_dict()["priors"]` of the result shows this.
        """
        localizer = self._open()
        group = localizer.find_group(_check_name(name))
        answers = localizer.localize_group(group, name, arrays.to_position(position), arrays.to_gravity(gravity))
        return next(result for result in _to_results(answers) if result.name == name)

    def localize_photo(
        self,
        image: Path | NDArray[np.uint8],
        camera: CameraInput | None = None,
        *,
        name: str | None = None,
        position: PositionPrior | None = None,
        gravity: GravityPrior | None = None,
    ) -> Result:
        """Extracts the features of a photo, matches them with the database, and localizes the photo.

        `image`: a file (relative to the option image_path, if it is set), or a uint8 array of height x width (grey) or
        height x width x 3 (RGB). The database must contain the descriptors of the posed images.
        `camera`: "MODEL width height params...", a dict with the keys model, width, height and params, or an object
        with these attributes, such as pycolmap.Camera. If you pass no camera, the program uses the first intrinsics
        that exist: of a camera in the model with the photo's size, from EXIF, or COLMAP's guess. It corrects these
        intrinsics from the images.
        `name`: the query's name; default: the path of the file, or "photo" for an array. The name also determines the
        random numbers of the localization.
        `position`, `gravity`: see `localize`.
        """
        return self._localize_alone(Photo(image, camera, name, position, gravity))

    def localize_matches(
        self,
        camera: CameraInput,
        keypoints: ArrayLike,
        pairs: Mapping[str, PairInput],
        *,
        name: str = "query",
        position: PositionPrior | None = None,
        gravity: GravityPrior | None = None,
    ) -> Result:
        """Localizes a query from features and matches of your own.

        `camera`: see `localize_photo`.
        `keypoints`: array of the query's keypoints, n x 2, with x and y in pixels.
        `pairs`: {name of a posed image: (keypoints, matches)}. `keypoints` is an m x 2 array with the keypoints of the
        posed image, x and y in pixels. Each row of `matches` (k x 2) has the index of a query keypoint, and the index
        of a keypoint of the posed image. If you pass only the matches, the keypoints of the posed image are read from
        the database. The program verifies the matches with COLMAP's two-view geometry.
        `position`, `gravity`: see `localize`.
        """
        return self._localize_alone(Matches(camera, keypoints, pairs, name, position, gravity))

    def localize_rig(self, images: Mapping[QueryT, PoseInput], *, name: str = "rig") -> dict[str, Result]:
        """Localizes the images that a camera rig took at one moment; returns the results by name.

        `images`: {query: cam_from_rig}. A query is the name of one of `queries`, a `Photo` or a `Matches`. The pose
        cam_from_rig is a 3x4 or 4x4 matrix, (R, t), a `colmap_lazyloc.poses.Pose`, a pycolmap.Rigid3d or a
        pycolmap.Image, with lengths in the model's unit. The poses cam_from_rig stay fixed.
        """
        return self._localize_frame(images, name, has_scale=True)

    def localize_trajectory(self, images: Mapping[QueryT, PoseInput], *, has_scale: bool = True) -> dict[str, Result]:
        """Localizes images with known relative poses, for example from odometry or SLAM, as one rigid body.

        `images`: {query: cam_from_world}, with the poses in the trajectory's coordinates. For the types of queries and
        poses, see `localize_rig`.
        `has_scale`: False if lengths in the trajectory are not in the model's unit; their scale is then estimated.
        """
        return self._localize_frame(images, None, has_scale=has_scale)

    def localize_all(
        self, queries: Iterable[Query] | None = None, *, num_threads: int | None = None, progress: bool = False
    ) -> Iterator[Result]:
        """Localizes many queries on several threads. Returns a generator, which yields each result when it is finished.

        `queries`: `Photo` or `Matches` objects, or names from the property `queries`; default: all of these names.
        `num_threads`: number of threads; -1 means all cores; default: the property `num_threads`.
        `progress`: True shows a progress bar (tqdm) on the standard error output.

        After Ctrl-C, or when the generator is closed, the running queries are finished and no new queries start.
        """
        localizer = self._open()
        num_threads = self.num_threads if num_threads is None else num_threads
        if not isinstance(num_threads, int) or (num_threads < 1 and num_threads != -1):
            raise InputError("num_threads must be >= 1, or -1")
        if queries is not None and (isinstance(queries, str | np.ndarray) or not isinstance(queries, Iterable)):
            raise InputError(f"queries: must be a list of queries, but is of type {type(queries).__name__}")
        groups = localizer.groups()
        if queries is None:
            names, others = [name for group in groups for name in group], []
        else:
            queries = list(queries)
            names, others = [q for q in queries if isinstance(q, str)], [q for q in queries if not isinstance(q, str)]
        names_of_group: dict[int, set[str]] = {}
        for name in names:
            names_of_group.setdefault(localizer.find_group(_check_name(name)), set()).add(name)
        inputs = [_to_input(localizer, query) for query in others]
        tasks: list[Callable[[], list[Result]]] = [
            *(_group_task(localizer, group, wanted) for group, wanted in names_of_group.items()),
            *(_input_task(localizer, query) for _, query in inputs),
        ]
        num_queries = len(inputs) + sum(map(len, names_of_group.values()))
        return run_tasks(tasks, num_threads if num_threads > 0 else os.cpu_count() or 1, num_queries, progress)

    def _open(self) -> _core.Localizer:
        if self._core is None:
            raise InputError("the Localizer is closed")
        return self._core

    def _localize_alone(self, query: Query) -> Result:
        localizer = self._open()
        return _input_task(localizer, _to_input(localizer, query)[1])()[0]

    def _localize_frame(
        self, images: Mapping[QueryT, PoseInput], name: str | None, *, has_scale: bool
    ) -> dict[str, Result]:
        localizer = self._open()
        if not isinstance(images, Mapping) or not images:
            raise InputError("images: must be a dict of at least one query with its pose")
        if self._is_leave_one_out:
            raise InputError("leave_one_out needs the groups of the options, such as rig_config_path")
        frame: dict[str, tuple[_core.Query, NDArray[np.float64]]] = {}
        for query, pose in images.items():
            query_name, query_input = _to_input(localizer, query)
            if query_name in frame:
                raise InputError(f"query {query_name} is given twice")
            frame[query_name] = (query_input, arrays.to_pose(pose, f"query {query_name}"))
        names = sorted(frame)  # like the command
        answers = localizer.localize_frame(
            [frame[query_name][0] for query_name in names],
            arrays.to_poses([frame[query_name][1] for query_name in names]),
            names[0] if name is None else _check_name(name),
            bool(has_scale),
        )
        return {result.name: result for result in sorted(_to_results(answers), key=lambda result: result.name)}


def _is_int(settings: Mapping[str, str]) -> bool:
    return settings.get("LazyLocalizer.num_threads", "-1").lstrip("-").isdecimal()


def _to_results(answers: Iterable[Answer]) -> list[Result]:
    return [Result(*answer) for answer in answers]


def _group_task(localizer: _core.Localizer, group: int, names: set[str]) -> Callable[[], list[Result]]:
    def localize() -> list[Result]:
        return [result for result in _to_results(localizer.localize_group(group, "", [], [])) if result.name in names]

    return localize


def _input_task(localizer: _core.Localizer, query: _core.Query) -> Callable[[], list[Result]]:
    return lambda: _to_results(localizer.localize_frame([query], arrays.to_poses([IDENTITY]), "", True))


def _to_input(localizer: _core.Localizer, query: Query) -> tuple[str, _core.Query]:
    """Returns a query's name and the extension module's query."""
    if isinstance(query, str):
        localizer.find_group(_check_name(query))  # raises InputError for an unknown one
        return query, core.named(query)
    if isinstance(query, Photo):
        name, plain = _to_photo(query)
        return name, _with_prior(localizer, plain, query)
    if isinstance(query, Matches):
        return query.name, _with_prior(localizer, _to_matches(localizer, query), query)
    raise InputError(f"a query must be a name, a Photo or a Matches, but is of type {type(query).__name__}")


def _with_prior(localizer: _core.Localizer, plain: _core.Query, query: Photo | Matches) -> _core.Query:
    return localizer.with_prior(plain, arrays.to_position(query.position), arrays.to_gravity(query.gravity))


def _to_photo(photo: Photo) -> tuple[str, _core.Query]:
    camera = None if photo.camera is None else arrays.to_camera(photo.camera)
    path, pixels = "", None
    if isinstance(photo.image, str | os.PathLike):
        path = os.fsdecode(photo.image)
        check_text(path, "photo: the path")
    else:
        pixels = arrays.to_pixels(photo.image)
    name = _check_name((path or "photo") if photo.name is None else photo.name)
    return name, core.photo(name, path, pixels, camera)


def _to_matches(localizer: _core.Localizer, query: Matches) -> _core.Query:
    if not isinstance(query.pairs, Mapping):
        raise InputError("pairs: must be a dict with the name of a posed image for each pair")
    pairs = []
    for name, value in query.pairs.items():
        label = f"pair with {name}"
        _check_name(name)
        given, matches = value if isinstance(value, tuple) and len(value) == 2 else (None, value)
        keypoints = None if given is None else arrays.to_rows(given, 2, f"{label}: keypoints")
        pairs.append((name, keypoints, arrays.to_matches(matches, label)))
    keypoints = arrays.to_rows(query.keypoints, 2, "keypoints")
    return localizer.matches(_check_name(query.name), arrays.to_camera(query.camera), keypoints, pairs)


def _check_name(name: object) -> str:
    if not isinstance(name, str) or not name:
        kind = "empty" if isinstance(name, str) else f"of type {type(name).__name__}"
        raise InputError(f"a query's name must be a string of at least one character, but is {kind}")
    check_text(name, "a query's name")
    return name

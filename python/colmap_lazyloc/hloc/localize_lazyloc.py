"""Localizes queries from hloc's features and matches, and from the poses of the database images in a COLMAP model.

`main` has the parameters of `hloc.localize_sfm.main`, and writes the same files. `results` has one line
`name qw qx qy qz tx ty tz` per localized query. `results_logs.pkl` has the form of hloc's InLoc pipeline, so that
`hloc.visualization.visualize_loc` reads it without a reconstruction. A query that cannot be localized has no line in
`results`, while hloc writes the pose of the most similar database image. Needs h5py.
"""

import argparse
import os
import pathlib
import pickle
import sys
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError, Parser, command, nearest
from colmap_lazyloc.hloc_files import find_matches, read_keypoints
from colmap_lazyloc.inputs import Matches, Options
from colmap_lazyloc.localizer import Localizer
from colmap_lazyloc.model import Camera, Model, ModelLike, read_model
from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.queries import read_query_cameras
from colmap_lazyloc.report.output import check_output
from colmap_lazyloc.result import Result
from colmap_lazyloc.text_files import Path

if TYPE_CHECKING:
    import h5py

COLMAP_FROM_HLOC = 0.5  # pixels: hloc's upper-left pixel has its centre at 0, 0


def main(
    reference_sfm: Path | ModelLike,
    queries: Path,
    retrieval: Path,
    features: Path,
    matches: Path,
    results: Path,
    ransac_thresh: float = 12,
    covisibility_clustering: bool = False,
    prepend_camera_name: bool = False,
    config: Options | None = None,
) -> dict[str, Result]:
    """Localizes the queries and returns their results by name.

    `reference_sfm`: the folder of a COLMAP model, a pycolmap.Reconstruction, or a `colmap_lazyloc.model.Model`.
    `config`: options of `Localizer`. `ransac_thresh` and `covisibility_clustering` are accepted for hloc's sake and
    have no effect: pairs are verified by two-view geometry, and the query's pairs check each other.
    """
    import h5py

    del ransac_thresh, covisibility_clustering
    check_output(pathlib.Path(results), is_folder=False)
    model = read_model(reference_sfm) if isinstance(reference_sfm, str | os.PathLike) else Model.of(reference_sfm)
    cameras = read_query_cameras(queries)
    names_of_query = _retrieved(retrieval, cameras, model)
    found: dict[str, Result] = {}
    logs: dict[str, dict[str, object]] = {}
    with h5py.File(features, "r") as feature_file, h5py.File(matches, "r") as match_file:
        inputs = {
            name: _read_query(name, cameras[name], database_names, feature_file, match_file)
            for name, database_names in names_of_query.items()
        }
    with Localizer(None, model, options=config) as localizer:
        for result in localizer.localize_all(Matches(*query, name) for name, query in inputs.items()):
            found[result.name] = result
    lines = []
    for name, query in inputs.items():
        logs[name] = _make_log(query, found[name])
        if (pose := found[name].pose) is not None:
            lines.append(f"{_short_name(name, prepend_camera_name)} {pose.text()}\n")
    pathlib.Path(results).write_text("".join(lines), encoding="utf-8")
    with open(f"{results}_logs.pkl", "wb") as file:
        pickle.dump({"features": features, "matches": matches, "retrieval": retrieval, "loc": logs}, file)
    return found


def _retrieved(retrieval: Path, cameras: Mapping[str, Camera], model: Model) -> dict[str, list[str]]:
    """Returns the posed images for each query, in the order of the query list."""
    names: dict[str, list[str]] = {name: [] for name in cameras}
    pairs = read_pairs(retrieval)
    for pair in pairs:
        for query, other in (pair, pair[::-1]):
            if query in names and other in model.images and other not in names[query]:
                names[query].append(other)
    if not any(names.values()):
        known = dict.fromkeys([*cameras, *model.images])
        unknown = next((name for pair in pairs for name in pair if name not in known), None)
        hint = "" if unknown is None else f": {unknown} is neither{nearest(unknown, known)}"
        raise InputError(f"{retrieval}: no pair of a query with an image of the model{hint}")
    return names


class _Query(NamedTuple):
    """A query of hloc's files, with the keypoints and matches of each posed image."""

    camera: Camera
    keypoints: NDArray[np.float32]
    pairs: dict[str, tuple[NDArray[np.float32], NDArray[np.uint32]]]


def _read_query(
    name: str, camera: Camera, database_names: list[str], features: "h5py.File", matches: "h5py.File"
) -> _Query:
    pairs = {}
    for other in database_names:
        found = find_matches(matches, name, other)
        if found is None:
            raise InputError(f"{matches.filename}: has no matches of {name} and {other}")
        pairs[other] = (read_keypoints(features, other), found)
    return _Query(camera, read_keypoints(features, name), pairs)


def _observed(result: Result) -> Iterator[tuple[int, str, int]]:
    """Yields the matches that a localized query's points rest on: keypoint, name and keypoint of the database image."""
    names = [pair["name"] for pair in result.as_dict()["pairs"]]
    for point, pair, keypoint in result.observations:
        yield int(result.point_keypoints[point]), names[pair], int(keypoint)


def _make_log(query: _Query, result: Result) -> dict[str, object]:
    """Returns the entry of a query in the form of hloc's InLoc pipeline: one row per match with a database image."""
    observed = set(_observed(result))
    query_keypoints = query.keypoints - COLMAP_FROM_HLOC
    keypoints, database_keypoints, indices, inliers = [], [], [], []
    for index, (name, (other_keypoints, found)) in enumerate(query.pairs.items()):
        keypoints.append(query_keypoints[found[:, 0]])
        database_keypoints.append(other_keypoints[found[:, 1]] - COLMAP_FROM_HLOC)
        indices.append(np.full(len(found), index))
        inliers += [(int(own), name, int(other)) in observed for own, other in found]
    camera = query.camera
    return {
        "db": list(query.pairs),
        "PnP_ret": {
            "success": result.is_localized,
            "status": result.status,
            "reason": result.reason,
            "cam_from_world": result.cam_from_world,
            "num_inliers": int(np.count_nonzero(inliers)),
            "inlier_mask": np.array(inliers, np.bool_),
            "cfg": {"model": camera.model, "width": camera.width, "height": camera.height, "params": camera.params},
        },
        "keypoints_query": np.concatenate([np.zeros((0, 2)), *keypoints]),
        "keypoints_db": np.concatenate([np.zeros((0, 2)), *database_keypoints]),
        "indices_db": np.concatenate([np.zeros(0, int), *indices]),
        "num_matches": len(inliers),
    }


def _short_name(name: str, with_camera: bool) -> str:
    """Returns the file name, or the last folder and the file name, as hloc writes them."""
    return "/".join(name.split("/")[-2 if with_camera else -1 :])


@command(extra="hloc")
def command_line(arguments: list[str] | None = None) -> None:
    """Runs `main` with hloc's flags."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("reference_sfm", "queries", "features", "matches", "retrieval", "results"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("--ransac_thresh", type=float, default=12.0, help="no effect")
    parser.add_argument("--covisibility_clustering", action="store_true", help="no effect")
    parser.add_argument("--prepend_camera_name", action="store_true")
    options = vars(parser.parse_args(arguments))
    found = main(**options)
    print(f"{sum(result.is_localized for result in found.values())} of {len(found)} queries localized")


if __name__ == "__main__":
    sys.exit(command_line())

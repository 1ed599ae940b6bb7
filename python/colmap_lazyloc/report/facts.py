"""Puts what is known of a query into words."""

from collections.abc import Callable, Mapping

from colmap_lazyloc.model import Camera
from colmap_lazyloc.report.geometry import focal_lengths
from colmap_lazyloc.result_fields import IntrinsicsFields, ResultFields

METRE, MODEL_UNITS = "m", "units"  # of lengths: the second is that of the model, whatever it is

_STARTS = {
    "motion_averaging": "averaging of the relative poses to the database images",
    "absolute_pose": "points triangulated from the database images",
    "generalized_relative_pose": "relative pose to several database images at once",
    "depth": "depth maps of database images",
}
_SOURCES = {
    "query_list": "the query list",
    "model": "the input model",
    "database": "the database, where the image is listed",
    "camera_params": "the option ImageReader.camera_params",
    "joint": "estimated from several queries of one camera",
    "database_camera": "a camera of the database images with the same image size",
    "exif": "EXIF data of the photo",
    "guess": "a guess: 1.2 times the image's longer side",
}
_MATCHING_TYPES = {
    "SIFT_BRUTEFORCE": "SIFT features",
    "ALIKED_BRUTEFORCE": "ALIKED features",
    "ALIKED_LIGHTGLUE": "ALIKED features, matched by LightGlue",
}
_ORIGINS = {  # of a focal length that was replaced
    "given": "the given",
    "model": "the model's",
    "shared": "the database camera's",
    "similar": "the database camera's",
    "exif": "EXIF's",
    "guess": "the guessed",
}
_VERDICTS = {
    "confirmed": "the images agree with it",
    "unobservable": "the images do not determine it, so it was kept",
    "contradicted": "the images contradict it",
    "refined": "estimated from the images",
    "not_tested": "not tested, because no bundle adjustment came to an end",
}


_PRIOR_VERDICTS = {
    "used": "used",
    "contradicted": "contradicted by the images, and left out",
    "not_tested": "not used, because the images give no pose to compare it with",
}
_PRIOR_ROLES = {
    "distance": ": it fixes the place on the line along which the images do not determine it",
    "position": ": it fixes the position, which the images do not determine",
}


def facts(result: ResultFields, unit: str, camera: Camera | None = None) -> list[tuple[str, str]]:
    """Returns the rows of a table, label and text; without what the table of queries has.

    `camera`: that of the pose; None if it is unknown.
    """
    rows = _certainty_rows(result, unit)
    rows += _evidence_rows(result, unit)
    rows += _prior_rows(result, unit)
    rows += _camera_rows(result, camera)
    rows += _group_rows(result)
    return [(label, text) for label, text in rows if text]


def _certainty_rows(result: ResultFields, unit: str) -> list[tuple[str, str]]:
    rows = []
    stddevs, weakest_direction = result.get("position_stddevs"), result.get("weakest_direction")
    if stddevs and weakest_direction:
        largest, middle, smallest = (format_length(stddev, unit) for stddev in stddevs)
        direction = ", ".join(f"{component:.2f}" for component in weakest_direction)
        text = f"{largest}, {middle} and {smallest} along the principal axes; least certain along ({direction})"
        rows.append(("Position, standard deviation", text))
    if result.get("rotation_stddev_deg") is not None:
        text = f"{result['rotation_stddev_deg']:.3g}° about the least certain axis"
        rows.append(("Rotation, standard deviation", text))
    bearing = result.get("bearing")
    if bearing is not None:
        direction = ", ".join(f"{component:.4f}" for component in bearing["direction"])
        text = f"on the line from {bearing['from']} along ({direction}), which is known to {bearing['stddev_deg']:.3g}°"
        rows.append(("Position", text))
    return rows


def _evidence_rows(result: ResultFields, unit: str) -> list[tuple[str, str]]:
    num_tracks, num_observations = result.get("num_tracks", 0), result.get("num_observations", 0)
    matching = result.get("matching_type") or ""
    rows = [("Matched by", _MATCHING_TYPES.get(matching, matching))]
    if num_tracks > 0:
        rows.append(
            ("Points", f"{num_tracks} points, seen {num_observations} times in the query and in database images")
        )
    error_px = result.get("mean_reprojection_error_px")
    if error_px is not None:
        rows.append(("Reprojection error", f"{error_px:.2f} px on average"))
    evidence: Mapping[str, object] = result.get("evidence") or {}
    texts: tuple[tuple[str, str, Callable[[float], str]], ...] = (
        ("num_common_tracks", "Points in two or more database images", lambda value: f"{value:.0f}"),
        (
            "explained_ratio",
            "Matches that the pose explains",
            lambda value: f"{100 * value:.0f} % of the verified ones",
        ),
        ("scene_distance", "Distance of the points", lambda value: f"{format_length(value, unit)} (median)"),
    )
    for name, label, text in texts:
        value = evidence.get(name)
        if isinstance(value, int | float):
            rows.append((label, text(value)))
    rows.append(("Start of the refinement", _STARTS.get(result.get("start", ""), result.get("start", ""))))
    return rows


def _prior_rows(result: ResultFields, unit: str) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    priors = result.get("priors")
    if priors is None:
        return rows
    for name, label, prior in (
        ("position", "Given position", priors["position"]),
        ("gravity", "Given direction of gravity", priors["gravity"]),
    ):
        if prior is None:
            continue
        text = _PRIOR_VERDICTS.get(prior["verdict"], prior["verdict"]) + _PRIOR_ROLES.get(prior["fixes"], "")
        if prior["deviation"] is not None:
            deviation = format_length(prior["deviation"], unit) if name == "position" else f"{prior['deviation']:.3g}°"
            text += f"; {deviation} from what the images determine, {prior['deviation_sigma']:.1f} standard deviations"
        rows.append((label, text))
    return rows


def _camera_rows(result: ResultFields, camera: Camera | None) -> list[tuple[str, str]]:
    rows = []
    source = result.get("intrinsics_source")
    if source is not None:
        rows.append(("Intrinsics from", _SOURCES.get(source, source)))
    intrinsics = result.get("intrinsics")
    if intrinsics is not None:
        rows.append(("Focal length", _focal_length_text(intrinsics, camera)))
        rows.append(("Contradiction", intrinsics.get("contradiction") or ""))
    estimated = result.get("camera")
    if estimated is not None:
        params = ", ".join(f"{param:g}" for param in estimated["params"])
        text = f"{estimated['model']} {estimated['width']} x {estimated['height']}: {params}"
        rows.append(("Estimated camera", text))
    return rows


def _focal_length_text(intrinsics: IntrinsicsFields, camera: Camera | None) -> str:
    """Returns the verdict with focal lengths in pixels, as far as they are known."""
    verdict = _VERDICTS.get(intrinsics["verdict"], intrinsics["verdict"])
    factor, stddev = intrinsics.get("focal_factor"), intrinsics.get("focal_factor_stddev")
    if camera is None or factor is None or stddev is None:
        return verdict
    focal_px = sum(focal_lengths(camera)) / 2
    if intrinsics["verdict"] == "refined":
        before_px, origin = focal_px / factor, _ORIGINS.get(intrinsics["origin"], intrinsics["origin"])
        return f"{focal_px:.0f} ± {before_px * stddev:.2g} px, not {origin} {before_px:.0f} px: {verdict}"
    return f"{focal_px:.0f} px: {verdict}; they suggest {focal_px * factor:.0f} ± {focal_px * stddev:.2g} px"


def _group_rows(result: ResultFields) -> list[tuple[str, str]]:
    rows = [("Frame", result.get("frame") or "")]
    if result.get("rig_scale") is not None:
        rows.append(("Scale of the trajectory", f"{result['rig_scale']:.6g} units of the model per unit"))
    if result.get("rig_error_px") is not None:
        rows.append(("Error within the rig", f"{result['rig_error_px']:.2f} px (median)"))
    return rows


def format_length(length: float, unit: str) -> str:
    """Returns a length with its unit; metres have the prefix that a reader sees at once."""
    if unit != METRE:
        return f"{length:.3g} {unit}"
    if length >= 1:
        return f"{length:.3g} m" if length < 1000 else f"{length:.0f} m"
    return f"{100 * length:.2g} cm" if length >= 0.01 else f"{1000 * length:.2g} mm"

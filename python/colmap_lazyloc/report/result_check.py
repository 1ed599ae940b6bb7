"""Checks a line of results.jsonl, which may come from another version or be damaged."""

import math
from collections.abc import Callable, Mapping
from typing import TypeGuard

from colmap_lazyloc.errors import InputError

Check = Callable[[object], bool]

# Fields that every result has; others are missing in runs of older versions.
_REQUIRED = ("name", "status", "reason", "cam_from_world", "pairs", "seconds")
_TEXTS = ("name", "status", "reason")
_OPTIONAL_TEXTS = ("start", "frame", "intrinsics_source", "matching_type")
_NUMBERS = ("confidence", "rotation_stddev_deg", "mean_reprojection_error_px", "rig_error_px", "rig_scale")
_COUNTS = ("num_tracks", "num_observations")
_VECTORS = {"position_stddevs": 3, "weakest_direction": 3, "rotation": 4}
_POSES = ("cam_from_world", "unconfirmed_cam_from_world")


def check_result(place: str, result: Mapping[str, object]) -> None:
    """Checks the types of all fields that a report reads; errors name `place`."""
    checks: dict[str, Check] = {
        **{name: _is_text for name in _TEXTS},
        **{name: _or_null(_is_text) for name in _OPTIONAL_TEXTS},
        **{name: _or_null(_is_number) for name in _NUMBERS},
        **{name: _is_count for name in _COUNTS},
        **{name: _or_null(_is_vector(length)) for name, length in _VECTORS.items()},
        **{name: _or_null(_is_pose) for name in _POSES},
        "covariance": _or_null(lambda value: _is_list(value, 6) and all(map(_is_vector(6), value))),
        "bearing": _or_null(_is_bearing),
        "camera": _or_null(_is_camera),
        "evidence": _or_null(_is_evidence),
        "intrinsics": _or_null(_is_intrinsics),
        "pairs": lambda value: isinstance(value, list) and all(map(_is_pair, value)),
        "seconds": lambda value: isinstance(value, dict) and all(map(_is_number, value.values())),
    }
    missing = [name for name in _REQUIRED if name not in result]
    if missing:
        raise InputError(f"{place}: query '{result['name']}' has no '{missing[0]}'")
    wrong = [name for name, check in checks.items() if name in result and not check(result[name])]
    if wrong:
        raise InputError(f"{place}: '{wrong[0]}' of query '{result['name']}' is not what a run writes")


def _or_null(check: Check) -> Check:
    return lambda value: value is None or check(value)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and 0 <= value < 2**31


def _is_list(value: object, length: int) -> TypeGuard[list[object]]:
    return isinstance(value, list) and len(value) == length


def _is_vector(length: int) -> Check:
    return lambda value: _is_list(value, length) and all(map(_is_number, value))


def _is_pose(value: object) -> bool:
    return (
        isinstance(value, dict)
        and _is_vector(4)(value.get("qvec"))
        and _is_vector(3)(value.get("tvec"))
        and abs(math.hypot(*value["qvec"]) - 1) < 0.01
    )


def _is_pair(value: object) -> bool:
    return (
        isinstance(value, dict)
        and _is_text(value.get("name"))
        and _is_count(value.get("num_inliers"))
        and all(_or_null(_is_number)(value.get(name, "")) for name in ("rotation_error_deg", "direction_error_deg"))
    )


def _is_bearing(value: object) -> bool:
    return (
        isinstance(value, dict)
        and _is_text(value.get("from"))
        and _is_vector(3)(value.get("direction"))
        and _is_number(value.get("stddev_deg"))
    )


def _is_camera(value: object) -> bool:
    return (
        isinstance(value, dict)
        and _is_text(value.get("model"))
        and all(_is_count(value.get(name)) for name in ("width", "height"))
        and isinstance(value.get("params"), list)
        and all(map(_is_number, value["params"]))
    )


def _is_evidence(value: object) -> bool:
    return isinstance(value, dict) and all(map(_or_null(_is_number), value.values()))


def _is_intrinsics(value: object) -> bool:
    return (
        isinstance(value, dict)
        and _is_text(value.get("verdict"))
        and _or_null(_is_text)(value.get("contradiction"))
        and all(_or_null(_is_number)(value.get(name)) for name in ("focal_factor", "focal_factor_stddev"))
    )

"""What the service's OpenAPI document says of requests and answers."""

import contextlib
import functools
from collections.abc import Iterable
from typing import Any

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.extension import core
from colmap_lazyloc.model import CAMERA_MODELS, num_focal_lengths
from colmap_lazyloc.serve.geopose import MAX_NUMBER, MAX_SIDE, OTHER_NAMES, UNKNOWN_CAMERAS
from colmap_lazyloc.serve.query import SESSION

ERRORS = {
    400: "The body is empty, not a form, or no request of the GeoPose Protocol",
    401: "No valid bearer token",
    404: "The photo is not localized",
    408: "The photo did not arrive in time",
    409: "The database cannot be opened; the one before stays in use",
    413: "Too many bytes or pixels",
    415: "Neither JPEG nor PNG",
    422: "A field that cannot be used, or a damaged photo",
    501: "The model is not geographic",
    503: "Too many photos are waiting: try again after the seconds of Retry-After",
    504: "The localization takes too long",
}
# Numbers as text, as long as any use needs, and never 0 where that has no meaning.
NUMBER = r"[-+]?[0-9]{1,9}(\.[0-9]{1,9})?"
POSITIVE = r"[1-9][0-9]{0,4}(\.[0-9]{1,9})?"
STDDEV = r"([1-9][0-9]{0,8}(\.[0-9]{1,9})?|0\.0{0,5}[1-9][0-9]{0,2})"
DIRECTION = rf"(?!([-+]?0+(\.0+)?[ ,]){{3}}){NUMBER}([ ,]{NUMBER}){{2}}"
SIZE = r"[1-9][0-9]{0,4}"
COVARIANCE = rf"{NUMBER}([ ,]{NUMBER}){{5}}"


@functools.cache
def _known_models() -> list[tuple[str, int]]:
    """Returns the camera models that this build knows, with their numbers of parameters."""
    known = []
    for model, count in CAMERA_MODELS:
        with contextlib.suppress(InputError):
            core.Camera(model, 1, 1, [1.0] * count)
            known.append((model, count))
    return known


def _camera_pattern() -> str:
    """Returns the pattern of a camera: for each model that this build knows, its parameters, focal lengths first."""
    models = [
        f"{model}([ ,]{SIZE}){{2}}([ ,]{POSITIVE}){{{num_focal_lengths(model)}}}"
        + (f"([ ,]{NUMBER}){{{count - num_focal_lengths(model)}}}" if count > num_focal_lengths(model) else "")
        for model, count in _known_models()
    ]
    return f"^({'|'.join(models)})$"


def _fields(has_world_up: bool) -> dict[str, tuple[str, str, str]]:
    """Returns text, example and pattern of each field."""
    fields = {
        "camera": (
            "Intrinsics: MODEL width height params..., as COLMAP has them. Default: those of a database camera of this "
            "size, EXIF's focal length, or a guess, corrected by the images",
            "SIMPLE_RADIAL 4032 3024 3000 2016 1512 0.01",
            _camera_pattern(),
        ),
        "position": (
            "Where the camera was, in the model's coordinates: x y z and a standard deviation, three of them, or six "
            "numbers of a covariance (xx xy xz yy yz zz)",
            "4 1 1.5 3",
            rf"^{NUMBER}([ ,]{NUMBER}){{2}}[ ,]({STDDEV}(([ ,]{STDDEV}){{2}})?|{COVARIANCE})$",
        ),
        "session": (
            "A name for the photos of one phone or robot: the place of the last one, at most 3 seconds before, is then "
            "a `position`, unless the photo contradicts it",
            "phone-7",
            f"^{SESSION.pattern}$",
        ),
    }
    if has_world_up:
        fields["gravity"] = (
            "Where down is in the camera's axes (x right, y down, z forward): x y z and a standard deviation in "
            "degrees",
            "0 1 0.1 2",
            rf"^{DIRECTION}[ ,]{STDDEV}$",
        )
    return fields


BINARY = {"type": "string", "format": "binary", "minLength": 1}
NUMBERS = {"type": ["array", "null"], "items": {"type": "number"}}
POSE = {
    "type": ["object", "null"],
    "properties": {
        "qvec": {"type": "array", "items": {"type": "number"}, "description": "w x y z"},
        "tvec": {"type": "array", "items": {"type": "number"}},
    },
}
RESULT = {
    "title": "Result",
    "description": "The line of results.jsonl; the documentation of colmap_lazyloc lists all fields.",
    "type": "object",
    "required": ["name", "status", "reason", "confidence", "cam_from_world", "position", "covariance"],
    "properties": {
        "name": {"type": "string"},
        "status": {"type": "string", "description": "LOCALIZED, or why there is no pose to rely on"},
        "reason": {"type": "string"},
        "confidence": {"type": ["number", "null"], "description": "Probability that the position is right"},
        "cam_from_world": POSE,
        "position": NUMBERS,
        "position_stddevs": NUMBERS,
        "covariance": {"type": ["array", "null"], "description": "6x6: rotation, then translation"},
    },
}
NUMBER_TYPE = {"type": "number"}


def _object(required: Iterable[str] = (), **properties: Any) -> dict[str, Any]:
    return {"type": "object", "required": sorted(required or properties), "properties": properties}


def _numbers(*names: str) -> dict[str, Any]:
    return _object(**dict.fromkeys(names, NUMBER_TYPE))


def _or_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Returns the schema of a value that may be null, which is as good as none."""
    return {"anyOf": [schema, {"type": "null"}]}


READ_NUMBER = {"type": "number", "exclusiveMinimum": -MAX_NUMBER, "exclusiveMaximum": MAX_NUMBER}
BASE64 = r"^([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{4}|[A-Za-z0-9+/]{3}=|[A-Za-z0-9+/]{2}==)$"


def _params() -> dict[str, Any]:
    """Returns the schema of the intrinsics, each camera model with its number of parameters."""
    aliases = {name: alias for alias, name in OTHER_NAMES.items()}
    by_count: dict[tuple[int, int], list[str]] = {}
    for model, count in _known_models():
        names = [model, aliases[model]] if model in aliases else [model]
        by_count.setdefault((count, num_focal_lengths(model)), []).extend(names)
    no_numbers = {"type": "array", "maxItems": 0}
    unknown = {
        "type": "object",
        "properties": {"model": _or_null({"enum": list(UNKNOWN_CAMERAS)}), "modelParams": {"type": ["array", "null"]}},
    }
    known = [
        _object(
            ("model",),
            model={"enum": names},
            modelParams=_or_null(
                {
                    "anyOf": [
                        no_numbers,
                        {
                            "type": "array",
                            "minItems": count,
                            "maxItems": count,
                            "prefixItems": [{"type": "number", "exclusiveMinimum": 0}] * num_focal,
                            "items": READ_NUMBER,
                        },
                    ]
                }
            ),
        )
        for (count, num_focal), names in by_count.items()
    ]
    return {"anyOf": [*known, unknown, {"type": "null"}], "description": "A camera model of COLMAP"}


def _camera_reading() -> dict[str, Any]:
    side = {"type": "integer", "minimum": 1, "maximum": MAX_SIDE}
    return _object(
        ("imageBytes", "size"),
        timestamp=_or_null(READ_NUMBER),
        imageBytes={
            "type": "string",
            "format": "byte",
            "pattern": BASE64,
            "contentEncoding": "base64",
            "description": "A JPEG or PNG file",
        },
        imageFormat={
            "type": ["string", "null"],
            "not": {"enum": ["DEPTH"]},
            "description": "RGBA32, GRAY8: imageBytes may be these pixels without a file",
        },
        imageOrientation=_or_null({"type": "object", "properties": {"mirrored": {"enum": [False, None]}}}),
        size={"type": "array", "items": side, "minItems": 2, "maxItems": 2, "description": "width, height"},
        params=_params(),
    )


def _geolocation_reading() -> dict[str, Any]:
    return _object(
        ("latitude", "longitude"),
        latitude={"type": "number", "minimum": -90, "maximum": 90},
        longitude={"type": "number", "minimum": -360, "maximum": 360},
        **dict.fromkeys(("timestamp", "altitude", "accuracy", "altitudeAccuracy"), _or_null(READ_NUMBER)),
    )


def _geopose_request() -> dict[str, Any]:
    readings = {"type": "array", "items": _geolocation_reading()}
    return _object(
        ("id", "timestamp", "sensorReadings"),
        id={"type": "string"},
        timestamp=READ_NUMBER,
        type={"enum": ["geopose", None]},
        sensors={"description": "Is not used"},
        sensorReadings=_object(
            ("cameraReadings",),
            cameraReadings={"type": "array", "items": _camera_reading(), "minItems": 1, "maxItems": 1},
            geolocationReadings=_or_null(readings),
        ),
    )


GEOPOSE_ANSWER = _object(
    id={"type": "string"},
    timestamp=NUMBER_TYPE,
    accuracy=_numbers("position", "orientation"),
    type={"const": "geopose"},
    geopose=_object(position=_numbers("lat", "lon", "h"), quaternion=_numbers("x", "y", "z", "w")),
)
ERROR = {"title": "Error", "type": "object", "required": ["detail"], "properties": {"detail": {"type": "string"}}}


def describe_answers(statuses: Iterable[int]) -> dict[int | str, dict[str, Any]]:
    """Returns FastAPI's `responses` for errors, each a line."""
    return {
        status: {"description": ERRORS[status], "content": {"application/json": {"schema": ERROR}}}
        for status in statuses
    }


def describe_localize(has_world_up: bool) -> dict[str, Any]:
    """Returns FastAPI's arguments about a request with a photo, as its body or in a form, and about its answer.

    `has_world_up`: whether the service knows what gravity means.
    """
    fields = {
        name: {"type": "string", "pattern": pattern, "description": text, "examples": [example]}
        for name, (text, example, pattern) in _fields(has_world_up).items()
    }
    form = _object(("photo",), photo=BINARY, **fields) | {"additionalProperties": False}
    photos = {kind: {"schema": BINARY} for kind in ("image/jpeg", "image/png")}
    body = {"required": True, "content": {**photos, "multipart/form-data": {"schema": form}}}
    parameters = [
        {"name": name, "in": "query", "schema": schema, "description": schema["description"]}
        for name, schema in fields.items()
    ]
    return {
        "summary": "Localizes a photo",
        "description": "A photo that cannot be localized has an answer with status 200, too, which says why.",
        "openapi_extra": {
            "requestBody": body,
            "parameters": parameters,
            "responses": {"200": {"content": {"application/json": {"schema": RESULT}}}},
        },
    }


def describe_geopose() -> dict[str, Any]:
    """Returns FastAPI's arguments about a request of the GeoPose Protocol, and about its answer."""
    return {
        "summary": "Localizes a photo by the GeoPose Protocol 2.0 of Open AR Cloud",
        "openapi_extra": {
            "requestBody": {"required": True, "content": {"application/json": {"schema": _geopose_request()}}},
            "responses": {"200": {"content": {"application/json": {"schema": GEOPOSE_ANSWER}}}},
        },
    }

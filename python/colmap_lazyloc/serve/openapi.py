"""What the service's OpenAPI document says of requests and answers."""

from collections.abc import Iterable
from typing import Any

ERRORS = {
    400: "The body is empty, not a form, or no request of the GeoPose Protocol",
    401: "No valid bearer token",
    408: "The photo did not arrive in time",
    409: "The database cannot be opened; the one before stays in use",
    413: "Too many bytes or pixels",
    415: "Neither JPEG nor PNG",
    422: "A field that cannot be used, a damaged photo, or in the GeoPose Protocol one that is not localized",
    501: "The model is not geographic",
    503: "Too many photos are waiting: try again after the seconds of Retry-After",
    504: "The localization takes too long",
}
NUMBER = r"[-+]?[0-9]+(\.[0-9]+)?"
FIELDS = {  # text, example, pattern
    "camera": (
        "Intrinsics: MODEL width height params..., as COLMAP has them. Default: those of a database camera of this "
        "size, EXIF's focal length, or a guess, corrected by the images",
        "SIMPLE_RADIAL 4032 3024 3000 2016 1512 0.01",
        rf"^[A-Z_]+([ ,][0-9]+){{2}}([ ,]{NUMBER})+$",
    ),
    "position": (
        "Where the camera was, in the model's coordinates: x y z and a standard deviation, three of them, or six "
        "numbers of a covariance (xx xy xz yy yz zz)",
        "4 1 1.5 3",
        rf"^{NUMBER}([ ,]{NUMBER}){{3}}(([ ,]{NUMBER}){{2}}|([ ,]{NUMBER}){{5}})?$",
    ),
    "gravity": (
        "Where down is in the camera's axes (x right, y down, z forward): x y z and a standard deviation in degrees; "
        "needs the option LazyLocalizer.world_up",
        "0 1 0.1 2",
        rf"^{NUMBER}([ ,]{NUMBER}){{3}}$",
    ),
    "session": (
        "A name for the photos of one phone or robot: the place of the last one, at most 3 seconds before, is then a "
        "`position`, unless the photo contradicts it",
        "phone-7",
        r"^[A-Za-z0-9._-]{1,64}$",
    ),
}
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


CAMERA_READING = _object(
    ("timestamp", "imageBytes"),
    timestamp=NUMBER_TYPE,
    imageBytes={"type": "string", "minLength": 1, "contentEncoding": "base64", "description": "A JPEG or PNG file"},
    imageFormat={"type": "string", "description": "RGBA32, GRAY8: imageBytes may be these pixels without a file"},
    size={"type": "array", "items": NUMBER_TYPE, "minItems": 2, "maxItems": 2, "description": "width, height"},
    params=_object(
        ("model",),
        model={"type": "string", "description": "A camera model of COLMAP"},
        modelParams={"type": "array", "items": NUMBER_TYPE},
    ),
)
GEOLOCATION_READING = _object(
    ("timestamp", "latitude", "longitude"),
    **dict.fromkeys(("timestamp", "latitude", "longitude", "altitude", "accuracy", "altitudeAccuracy"), NUMBER_TYPE),
)
GEOPOSE_REQUEST = _object(
    ("id", "timestamp", "sensorReadings"),
    id={"type": "string"},
    timestamp=NUMBER_TYPE,
    type={"const": "geopose"},
    sensors={"type": "array"},
    sensorReadings=_object(
        ("cameraReadings",),
        cameraReadings={"type": "array", "items": CAMERA_READING, "minItems": 1, "maxItems": 1},
        geolocationReadings={"type": "array", "items": GEOLOCATION_READING},
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


def describe_localize() -> dict[str, Any]:
    """Returns FastAPI's arguments about a request with a photo, as its body or in a form, and about its answer."""
    fields = {
        name: {"type": "string", "pattern": pattern, "description": text, "examples": [example]}
        for name, (text, example, pattern) in FIELDS.items()
    }
    form = {"type": "object", "required": ["photo"], "properties": {"photo": BINARY, **fields}}
    photos = {kind: {"schema": BINARY} for kind in ("image/jpeg", "image/png", "application/octet-stream")}
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
            "requestBody": {"required": True, "content": {"application/json": {"schema": GEOPOSE_REQUEST}}},
            "responses": {"200": {"content": {"application/json": {"schema": GEOPOSE_ANSWER}}}},
        },
    }

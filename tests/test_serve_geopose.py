"""Tests of the GeoPose Protocol in `lazyloc serve`: a client that knows the protocol's README and nothing of the
project."""

import base64
import json
import math
import re
import uuid

import cv2
import httpx
import numpy as np
import pyproj
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc.pose_formats.geo import GeoOrigin
from test_serve import assert_one_line, png_of_size, serving

PLACE = GeoOrigin(47.3769, 8.5417, 408.0)
HEADERS = {"Content-Type": "application/json", "Accept": "application/vnd.oscp+json;version=2.0;"}
PRIVACY = {
    name: [] for name in ("dataRetention", "dataAcceptableUse", "dataSanitizationApplied", "dataSanitizationRequested")
}
TIME = 1_790_000_000_123
TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


@pytest.fixture(scope="module")
def geographic(photos, tmp_path_factory):
    """Returns the scene with a model that is geographic."""
    folder = tmp_path_factory.mktemp("geographic")
    copy = type(photos)(folder, photos.poses)
    copy.model_path.mkdir()
    for path in photos.model_path.iterdir():
        (copy.model_path / path.name).write_bytes(path.read_bytes())
    copy.database_path.symlink_to(photos.database_path)
    PLACE.write(copy.model_path)
    return copy


@pytest.fixture(scope="module")
def server(geographic):
    with serving(geographic, "--max_megabytes", 2, "--max_megapixels", 2, "--max_seconds", 20) as server:
        yield server


def request_of(photo, camera=None, place=None, **reading):
    """Returns a request: all fields of the README for a camera and a receiver of positions. `camera`: its model and
    parameters; `place`: longitude, latitude, height and the two accuracies; `reading`: other fields of the photo."""
    readings = {
        "cameraReadings": [
            {
                "timestamp": TIME,
                "sensorId": "camera",
                "privacy": PRIVACY,
                "sequenceNumber": 1,
                "imageFormat": "RGBA32",
                "size": [480, 360],
                "imageBytes": base64.b64encode(photo).decode(),
                "imageOrientation": {"mirrored": False, "rotation": 0},
                **reading,
            }
        ]
    }
    if camera is not None:
        readings["cameraReadings"][0]["params"] = {"model": camera[0], "modelParams": camera[1]}
    if place is not None:
        names = ("longitude", "latitude", "altitude", "accuracy", "altitudeAccuracy")
        more = {"timestamp": TIME, "sensorId": "gps", "privacy": PRIVACY, "heading": 0, "speed": 0}
        readings["geolocationReadings"] = [{**more, **dict(zip(names, place, strict=True))}]
    return {
        "id": str(uuid.uuid4()),
        "timestamp": TIME,
        "type": "geopose",
        "sensors": [{"id": "camera", "type": "camera"}, {"id": "gps", "type": "geolocation"}],
        "sensorReadings": readings,
    }


def post(server, request, path="/scrs/geopose", **headers):
    return server.client.post(path, content=json.dumps(request), headers={**HEADERS, **headers})


def axes_at(longitude, latitude):
    """Returns east, north and up at a place, as columns in ECEF."""
    return Rotation.from_euler("ZX", [90 + longitude, 90 - latitude], degrees=True).as_matrix()


def place_of(point):
    """Returns longitude, latitude and height of a point of the model."""
    origin = TO_ECEF.transform(PLACE.longitude_deg, PLACE.latitude_deg, PLACE.height_m)
    ecef = axes_at(PLACE.longitude_deg, PLACE.latitude_deg) @ point + origin
    return TO_ECEF.transform(*ecef, direction="INVERSE")


def errors_of(answer, pose):
    """Returns the distance in metres and the angle in degrees between an answer's camera and the true one."""
    place = [answer["geopose"]["position"][name] for name in ("lon", "lat", "h")]
    distance = np.linalg.norm(np.subtract(TO_ECEF.transform(*place), TO_ECEF.transform(*place_of(pose.cam_in_world))))
    turn = Rotation.from_quat([answer["geopose"]["quaternion"][name] for name in "xyzw"]).as_matrix()
    forward, left, up = (axes_at(*place[:2]) @ turn).T
    true = axes_at(PLACE.longitude_deg, PLACE.latitude_deg) @ pose.rotation.T  # columns: right, down, forward
    found = np.column_stack([-left, -up, forward])
    return distance, math.degrees(Rotation.from_matrix(found.T @ true).magnitude())


@pytest.mark.parametrize("path", ["/scrs/geopose", "/geopose"])
def test_answer_is_the_pose_on_the_earth(server, photos, jpeg, path):
    pose = photos.poses[photos.query_names[0]]
    request = request_of(jpeg)
    answer = post(server, request, path)
    assert answer.status_code == 200 and answer.headers["Content-Type"] == "application/json"
    content = answer.json()
    assert (content["id"], content["timestamp"], content["type"]) == (request["id"], TIME, "geopose")
    assert set(content) == {"id", "timestamp", "accuracy", "type", "geopose"}
    assert set(content["accuracy"]) == {"position", "orientation"}
    position_error, rotation_error_deg = errors_of(content, pose)
    assert position_error < 0.05 and rotation_error_deg < 0.3
    assert position_error < 3 * content["accuracy"]["position"] < 0.1
    assert rotation_error_deg < 3 * content["accuracy"]["orientation"] < 1


def test_camera_and_position_make_the_pose_more_accurate(server, photos, jpeg):
    name, *words = photos.camera_words.split()
    pose = photos.poses[photos.query_names[0]]
    camera = (name, list(map(float, words[2:])))
    place = (*place_of(pose.cam_in_world), 0.002, 0.002)
    accuracies = []
    for more in ({}, {"camera": camera}, {"camera": camera, "place": place}):
        content = post(server, request_of(jpeg, **more)).json()
        accuracies.append(content["accuracy"]["position"])
    assert errors_of(content, pose)[0] < 0.005
    assert accuracies[2] < 0.7 * accuracies[1] and accuracies[2] < 0.7 * accuracies[0]


@pytest.mark.parametrize("accuracies", [(0, 0), (0.02, 0), (0.02, None)])
def test_position_of_unknown_accuracy_is_not_believed(server, photos, jpeg, accuracies):
    """Clients write 0 for an unknown accuracy or height."""
    longitude, latitude, height = place_of(photos.poses[photos.query_names[0]].cam_in_world)
    accuracy, height_accuracy = accuracies
    shift = 0.001 if accuracy == 0 else 0.0
    request = request_of(jpeg, place=(longitude + shift, latitude, height + 200, accuracy, height_accuracy))
    answer = post(server, request).json()
    assert errors_of(answer, photos.poses[photos.query_names[0]])[0] < 0.05


def test_position_without_a_height_is_used(server, photos, jpeg):
    longitude, latitude, _ = place_of(photos.poses[photos.query_names[0]].cam_in_world)
    answer = post(server, request_of(jpeg, place=(longitude, latitude, None, 1e-300, 0.02)))
    assert errors_of(answer.json(), photos.poses[photos.query_names[0]])[0] < 0.05


@pytest.mark.parametrize("text", ["", "\ud800", "\n\x00", "ü"])
def test_id_is_any_text(server, jpeg, text):
    answer = post(server, {**request_of(jpeg), "id": text})
    assert answer.status_code == 200 and answer.json()["id"] == text


@pytest.mark.parametrize("form", ["RGBA32", "GRAY8"])
def test_pixels_without_a_file(server, photos, form):
    pixels = cv2.imread(str(photos.image_path / photos.query_names[0]))
    pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGBA if form == "RGBA32" else cv2.COLOR_BGR2GRAY)
    pose = photos.poses[photos.query_names[0]]
    camera = photos.camera_words.split()
    request = request_of(pixels.tobytes(), (camera[0], list(map(float, camera[3:]))), imageFormat=form)
    answer = post(server, request)
    assert answer.status_code == 200, answer.text
    assert errors_of(answer.json(), pose)[0] < 0.05
    request = request_of(bytes(1_600 * 1_300), imageFormat="GRAY8", size=[1_600, 1_300])
    assert_one_line(post(server, request), 413)


@pytest.mark.parametrize(
    ("accept", "status"),
    [("*/*", 200), ("application/vnd.oscp+json; version=2", 200), ("application/vnd.oscp+json;version=1.0", 400)],
)
def test_version_is_that_of_the_header(server, jpeg, accept, status):
    answer = post(server, request_of(jpeg), Accept=accept)
    assert answer.status_code == status
    if status != 200:
        assert_one_line(answer, 400, "the version is 1.0", "2.0")


def test_photo_that_is_not_localized_has_the_reason(server):
    request = request_of(png_of_size(480, 360))
    assert_one_line(post(server, request), 404, "the photo is not localized: NO_FEATURES: the query has no keypoints")


def change(path, value):
    """Returns a function that changes a value of a request; None removes it."""

    def apply(request):
        *parents, last = path.split(".")
        for name in parents:
            request = request[int(name) if name.isdecimal() else name]
        request[last] = value
        if value is None:
            del request[last]

    return apply


CAMERA = "sensorReadings.cameraReadings.0."
PLACES = "sensorReadings.geolocationReadings"


@pytest.mark.parametrize(
    ("path", "value", "status", "words"),
    [
        ("id", None, 400, ["id: is missing"]),
        ("id", 7, 400, ["id: must be a text"]),
        ("timestamp", "now", 400, ["timestamp: must be a number"]),
        ("timestamp", True, 400, ["timestamp: must be a number"]),
        ("timestamp", 10**400, 400, ["timestamp: must be a number"]),
        ("timestamp", math.inf, 400, ["timestamp: must be a number"]),
        ("type", "objects", 400, ["type: must be geopose"]),
        ("sensorReadings", None, 400, ["sensorReadings: is missing"]),
        ("sensorReadings", [], 400, ["sensorReadings: must be an object"]),
        ("sensorReadings.cameraReadings", [], 400, ["must have one photo, but has 0"]),
        ("sensorReadings.cameraReadings", [{}, {}], 400, ["must have one photo, but has 2"]),
        ("sensorReadings.cameraReadings", ["photo"], 400, ["params: is missing"]),
        (CAMERA + "imageBytes", None, 400, ["imageBytes: is missing"]),
        (CAMERA + "imageBytes", "", 400, ["the photo is empty"]),
        (CAMERA + "imageBytes", "data:image/jpeg;base64,AAAA", 400, ["imageBytes: is not Base64"]),
        (CAMERA + "imageBytes", "AAAA", 415, ["JPEG or PNG"]),
        (CAMERA + "imageFormat", "DEPTH", 415, ["DEPTH is no photo"]),
        (CAMERA + "imageOrientation", {"mirrored": True, "rotation": 0}, 400, ["mirrored"]),
        (CAMERA + "size", None, 400, ["size: is missing"]),
        (CAMERA + "size", [480], 400, ["size: must be the width and height"]),
        (CAMERA + "size", [480, 65536], 400, ["size: must be the width and height"]),
        (CAMERA + "params", {"model": "\n", "modelParams": [1]}, 400, ["model: has a character"]),
        (CAMERA + "params", {"model": "NONE", "modelParams": [1, 2, 3]}, 422, ["unknown camera model 'NONE'"]),
        (CAMERA + "params", {"model": "PINHOLE", "modelParams": ["x"]}, 422, ["params must be numbers"]),
        (CAMERA + "params", {"model": "PINHOLE", "modelParams": [1]}, 422, ["PINHOLE"]),
        (PLACES, None, 200, []),
        (PLACES, [], 200, []),
        (PLACES, {}, 400, ["must be a list"]),
        (PLACES, False, 400, ["must be a list"]),
        (PLACES, "here", 400, ["must be a list"]),
        (PLACES, [{"accuracy": 5, "latitude": 91, "longitude": 8}], 400, ["91, 8 is not a latitude"]),
        (PLACES, [{"accuracy": 5, "latitude": 47}], 400, ["longitude: is missing"]),
        (PLACES, [{"latitude": 47}], 400, ["longitude: is missing"]),
        (PLACES, [[]], 400, ["latitude: is missing"]),
    ],
)
def test_bad_request_is_one_line(server, jpeg, path, value, status, words):
    request = request_of(jpeg)
    change(path, value)(request)
    answer = post(server, request)
    if status == 200:
        assert answer.status_code == 200
    else:
        assert_one_line(answer, status, *words)


def test_garbage_is_one_line(server):
    for body in (b"", b"{", b"\xff", b"[]", b"null", b"[" * 9000, b'{"a":' * 9000, b"9" * 5000):
        assert_one_line(server.client.post("/scrs/geopose", content=body), 400)
    before = server.resident_kb()
    assert_one_line(server.client.post("/scrs/geopose", content=b"[" + b"[]," * 600_000 + b"[]]"), 400, "10000 values")
    assert_one_line(server.client.post("/scrs/geopose", content=bytes(2_000_001)), 413, "2 megabytes")
    bomb = request_of(png_of_size(10000, 10000))
    assert_one_line(post(server, bomb), 413, "10000 x 10000 pixels")
    assert server.resident_kb() - before < 50_000
    assert server.metrics()["lazyloc_received_bytes"] == 0


def test_model_must_be_geographic(photos, jpeg):
    with serving(photos) as server:
        assert_one_line(post(server, request_of(jpeg)), 501, "not geographic", "geo.json")


def test_tokens_and_queue_hold_here_too(geographic, jpeg, tmp_path):
    (tmp_path / "tokens").write_text("secret\n")
    with serving(geographic, "--tokens", tmp_path / "tokens", "--max_seconds", 1) as server:
        assert_one_line(post(server, request_of(jpeg)), 401, "token")
        assert post(server, request_of(jpeg), Authorization="Bearer secret").status_code == 200
        head = "POST /geopose HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer secret\r\nContent-Length: 1000\r\n\r\n"
        with server.connect() as connection:
            connection.sendall(head.encode() + b"{")
            assert re.match(rb"HTTP/1.1 408 ", connection.recv(1000))
        url = str(server.client.base_url)
    with pytest.raises(httpx.ConnectError):
        httpx.get(url)

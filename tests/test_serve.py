"""Tests of `lazyloc serve`: a server process on rendered photos, and clients that are good, careless and hostile."""

import concurrent.futures
import contextlib
import http.client
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
import zlib

import httpx
import numpy as np
import pytest
from playwright.sync_api import sync_playwright

import colmap_lazyloc as ll
from browser import ARGUMENTS, chromium_path
from colmap_lazyloc.model import Image, read_model, write_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.serve import __main__ as serve
from colmap_lazyloc.serve import geopose
from colmap_lazyloc.serve.map import Source
from conftest import MAX_SECONDS
from test_python_processes import ENVIRONMENT

SIFT = {"SiftExtraction.max_num_features": "1500", "SiftExtraction.first_octave": "0"}
ADDRESS = re.compile(r"lazyloc serve: http://127\.0\.0\.1:(\d+)/ ")
SAMPLE = re.compile(r'^[a-z_]+(\{[a-z_]+="[^"]*"(,[a-z_]+="[^"]*")*\})? [-+.\d]+(e[-+]?\d+)?$')


class Server:
    """A running `lazyloc serve`."""

    def __init__(self, photos, *words, num_threads=2):
        options = [word for name, value in SIFT.items() for word in (f"--{name}", value)]
        port = [] if "--port" in words else ["--port", 0]
        command = [sys.executable, "-m", "colmap_lazyloc", "serve", photos.model_path, *port, *options, *words]
        command += ["--database_path", photos.database_path, "--LazyLocalizer.num_threads", num_threads]
        self.process = subprocess.Popen(
            list(map(str, command)), stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, env=ENVIRONMENT
        )
        line = self.process.stderr.readline()
        assert ADDRESS.match(line), line + self.process.stderr.read()
        self.port = int(ADDRESS.match(line).group(1))
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=60)

    def localize(self, photo, **more):
        return self.client.post("/localize", content=photo, **more)

    def connect(self):
        return socket.create_connection(("127.0.0.1", self.port), timeout=60)

    def metrics(self):
        """Returns the values by name and labels."""
        lines = self.client.get("/metrics").text.splitlines()
        return {line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in lines if not line.startswith("#")}

    def wait_until(self, name, value):
        end = time.monotonic() + 60
        while self.metrics().get(name, 0) != value:
            assert time.monotonic() < end, (name, self.metrics())
            time.sleep(0.01)

    def resident_kb(self):
        with open(f"/proc/{self.process.pid}/status") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))

    def end(self):
        """Sends SIGTERM; returns the exit code and what the server has printed."""
        self.process.send_signal(signal.SIGTERM)
        _, errors = self.process.communicate(timeout=MAX_SECONDS)
        return self.process.returncode, errors


@contextlib.contextmanager
def serving(photos, *words, **more):
    server = Server(photos, *words, **more)
    try:
        yield server
    finally:
        server.client.close()
        ended = server.end()
    assert ended == (0, "")  # no traceback, whatever the clients did


@pytest.fixture(scope="module")
def server(photos):
    with serving(photos, "--max_megabytes", 2, "--max_megapixels", 2, "--max_seconds", 20) as server:
        yield server


def pose_errors(photos, answer):
    assert answer.status_code == 200, answer.text
    pose = answer.json()["cam_from_world"]
    return Pose(np.array(pose["qvec"]), np.array(pose["tvec"])).errors(photos.poses[photos.query_names[0]])


def assert_one_line(answer, status, *words):
    assert answer.status_code == status, answer.text
    detail = answer.json()["detail"]
    assert "\n" not in detail and all(word in detail for word in words), detail


def png_of_size(width, height):
    """Returns a PNG file that is black and has less than 5 kB for each million pixels."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    compressor = zlib.compressobj(1)
    rows = b"".join(compressor.compress(bytes(width + 1)) for _ in range(height)) + compressor.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_answer_is_the_result_of_the_localizer(server, photos, jpeg, tmp_path):
    answer = server.localize(jpeg)
    position_error, rotation_error_deg = pose_errors(photos, answer)
    assert position_error < 0.05 and rotation_error_deg < 0.3
    (tmp_path / "photo.jpg").write_bytes(jpeg)
    with ll.Localizer(photos.database_path, photos.model_path, options=SIFT) as localizer:
        expected = localizer.localize_photo(tmp_path / "photo.jpg", name="photo").as_dict()
    fields = answer.json()
    assert fields.pop("seconds") and expected.pop("seconds") and fields == expected


def test_form_and_query_give_what_else_is_known(server, photos, jpeg):
    x, y, z = photos.poses[photos.query_names[0]].cam_in_world
    fields = {"camera": photos.camera_words, "position": f"{x} {y} {z} 0.1"}
    in_form = server.client.post("/localize", files={"photo": jpeg}, data=fields)
    in_query = server.localize(jpeg, params={name: text.replace(" ", ",") for name, text in fields.items()})
    assert pose_errors(photos, in_form)[0] < 0.01
    assert in_form.json()["priors"]["position"]["verdict"] == "used"
    assert in_form.json()["cam_from_world"] == in_query.json()["cam_from_world"]
    covariance = server.localize(jpeg, params={"position": f"{x} {y} {z} 0.01 0 0 0.01 0 0.01"})
    assert covariance.json()["priors"]["position"]["verdict"] == "used"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"camera": "PINHOLE 4"}, ["camera"]),
        ({"camera": "NONE 480 360 1 1 1"}, ["unknown camera model 'NONE'"]),
        ({"position": "1 2 3"}, ["position: must be 4 or 6 or 9 numbers"]),
        ({"position": "1 2 3 x"}, ["position"]),
        ({"position": "1 2 nan 1"}, ["position"]),
        ({"position": "1 2 3 -1"}, ["deviation is not positive"]),
        ({"gravity": "0 1 0 1"}, ["gravity needs LazyLocalizer.world_up"]),
        ({"gravity": "0 1 0"}, ["gravity: must be 4 numbers"]),
        ({"GPS": "1 2 3 1"}, ["unknown field 'GPS'", "camera, position, gravity, session"]),
    ],
)
def test_bad_field_is_one_line(server, jpeg, fields, words):
    assert_one_line(server.client.post("/localize", files={"photo": jpeg}, data=fields), 422, *words)
    assert_one_line(server.localize(jpeg, params=fields), 422, *words)


def test_field_given_twice_is_one_line(server, jpeg):
    twice = [("position", "1 2 3 1"), ("position", "1 2 3 1")]
    assert_one_line(server.localize(jpeg, params=twice), 422, "position is given twice")
    answer = server.client.post("/localize", files={"photo": jpeg}, data={"position": ["1 2 3 1", "1 2 3 1"]})
    assert_one_line(answer, 422, "position is given twice")


def test_field_of_the_form_replaces_one_of_the_url(server, photos, jpeg):
    params = {"camera": "PINHOLE 1 1 1 1 0 0", "position": "1 2 3 1"}
    x, y, z = photos.poses[photos.query_names[0]].cam_in_world
    fields = {"camera": photos.camera_words, "position": f"{x} {y} {z} 0.1"}
    answer = server.client.post("/localize", files={"photo": jpeg}, data=fields, params=params)
    assert answer.json()["priors"]["position"]["verdict"] == "used"
    for name in fields:
        answer = server.client.post("/localize", files={"photo": jpeg}, data=fields, params={name: "1"})
        assert_one_line(answer, 422, name)


@pytest.mark.parametrize("principal_point", ["1e9 -5", "240 -1e5", "1e6 1e6"])
def test_principal_point_far_from_the_image_has_an_answer(server, jpeg, principal_point):
    """The rays are so close together that bounds of RANSAC are 0."""
    answer = server.localize(jpeg, params={"camera": f"PINHOLE 480 360 400 400 {principal_point}"})
    assert answer.status_code == 200 and answer.json()["status"] != "LOCALIZED"


def test_garbage_is_one_line(server, photos, jpeg):
    png = (photos.image_path / photos.query_names[0]).read_bytes()
    assert_one_line(server.localize(b""), 400, "empty")
    for garbage in (b"no photo", bytes(1000), jpeg[:2], jpeg[100:], png[:20], b"GIF89a" + bytes(100), b"II*\0"):
        assert_one_line(server.localize(garbage), 415, "JPEG or PNG")
    assert_one_line(server.localize(png[: len(png) // 2]), 422, "damaged")
    form = {"Content-Type": "multipart/form-data; boundary=x"}
    for body in (b"", b"--x", b"no form", b"--x\r\n\r\n\r\n--x--", b"--x\r\nA: b\r\n\r\n" + jpeg + b"\r\n--x--\r\n"):
        assert_one_line(server.localize(body, headers=form), 400)
    assert_one_line(server.localize(jpeg, headers={"Content-Type": "multipart/form-data"}), 400, "boundary")
    assert_one_line(server.client.post("/localize", files={"image": jpeg}), 422, "image")
    assert_one_line(server.client.post("/localize", files=[("photo", jpeg), ("photo", jpeg)]), 400, "Too many files")
    assert_one_line(server.client.post("/localize", files={"photo": jpeg}, data={"camera": "1 " * 9999}), 400)
    assert server.client.get("/localize").status_code == 405 and server.client.get("/none").status_code == 404


def test_cut_off_photo_is_refused_or_right(server, photos, jpeg):
    """COLMAP reads the rows of a JPEG file that have arrived, which may be enough."""
    statuses = set()
    for size in (300, 2000, len(jpeg) // 4, len(jpeg) // 2, len(jpeg) - 10):
        answer = server.localize(jpeg[:size])
        if answer.status_code == 200 and answer.json()["status"] == "LOCALIZED":
            assert pose_errors(photos, answer)[0] < 0.1
        elif answer.status_code != 200:
            assert_one_line(answer, answer.status_code)
            assert answer.status_code in (415, 422)
        statuses.add(answer.status_code)
    assert len(statuses) == 2


def test_bomb_is_refused_by_its_head(server):
    before = server.resident_kb()
    bomb = png_of_size(10000, 10000)
    assert len(bomb) < 500_000
    start = time.monotonic()
    assert_one_line(server.localize(bomb), 413, "10000 x 10000 pixels, more than 2 megapixels")
    assert time.monotonic() - start < 2 and server.resident_kb() - before < 50_000
    assert server.localize(png_of_size(1500, 1300)).json()["status"] != "LOCALIZED"  # black


def test_too_large_request_is_refused(server):
    assert_one_line(server.localize(bytes(2_000_001)), 413, "2 megabytes")
    chunks = (bytes(100_000) for _ in range(21))  # a stream, whose length is not stated
    assert_one_line(server.localize(chunks), 413, "2 megabytes")
    assert_one_line(server.client.post("/localize", files={"photo": bytes(2_000_001)}), 413, "2 megabytes")


def test_dropped_connections_leave_nothing(server, photos, jpeg):
    head = f"POST /localize HTTP/1.1\r\nHost: x\r\nContent-Length: {len(jpeg)}\r\n\r\n".encode()
    before = server.metrics().get('lazyloc_requests_total{path="/localize",status="499"}', 0)
    for size in (0, 1000, len(jpeg) - 1):
        with server.connect() as connection:
            connection.sendall(head + jpeg[:size])
            server.wait_until("lazyloc_received_bytes", size)
    server.wait_until('lazyloc_requests_total{path="/localize",status="499"}', before + 3)
    with server.connect() as connection:
        connection.sendall(head + jpeg)  # and gone before the answer
    for garbage in (b"\0" * 100, b"GET / HTTP/9.9\r\n\r\n", b"GET / HTTP/1.1\r\nHost", b"POST / HTTP/1.1\r\n\r\n"):
        with server.connect() as connection:
            connection.sendall(garbage)
    server.wait_until("lazyloc_running", 0)
    server.wait_until("lazyloc_received_bytes", 0)
    assert pose_errors(photos, server.localize(jpeg))[0] < 0.05


def test_page_is_served_and_loads_nothing(server):
    answer = server.client.get("/")
    assert answer.status_code == 200 and "capture=" in answer.text
    assert not re.search(r"(src|href)=|url\(|@import|https?:", answer.text)
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]


@pytest.mark.skipif(chromium_path() is None, reason="chromium is missing; scripts/setup.sh browser")
def test_page_shows_the_answer(server, photos, jpeg):
    x = photos.poses[photos.query_names[0]].cam_in_world[0]
    problems = []
    with sync_playwright() as playwright:
        program = playwright.chromium.launch(executable_path=chromium_path(), args=ARGUMENTS)
        page = program.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda message: message.type == "error" and problems.append(message.text))
        page.goto(str(server.client.base_url))
        page.locator("#photo").set_input_files({"name": "a.jpg", "mimeType": "image/jpeg", "buffer": jpeg})
        page.get_by_text("Found.").wait_for(timeout=30000)
        assert float(page.locator("#answer td").first.inner_text().split(",")[0]) == pytest.approx(x, abs=0.05)
        assert problems == []
        page.evaluate("""() => {
          const data = new DataTransfer();
          data.items.add(new File(["no photo"], "a.jpg"));
          document.dispatchEvent(new DragEvent("drop", {dataTransfer: data}));
        }""")
        page.get_by_text("the photo is not a JPEG or PNG file").wait_for(timeout=30000)
        assert page.locator("#answer tr").count() == 0
        program.close()


@pytest.mark.skipif(chromium_path() is None, reason="chromium is missing; scripts/setup.sh browser")
def test_page_takes_a_photo_by_the_camera(server, photos, jpeg, tmp_path):
    x = photos.poses[photos.query_names[0]].cam_in_world[0]
    (tmp_path / "camera.mjpeg").write_bytes(jpeg)  # the fake camera shows it again and again
    camera = ["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"]
    camera.append(f"--use-file-for-fake-video-capture={tmp_path / 'camera.mjpeg'}")
    with sync_playwright() as playwright:
        program = playwright.chromium.launch(executable_path=chromium_path(), args=[*ARGUMENTS, *camera])
        page = program.new_page()
        page.goto(str(server.client.base_url))
        page.get_by_role("button", name="Use the camera").click()
        page.get_by_role("button", name="Take the photo").click()
        page.get_by_text("Found.").wait_for(timeout=30000)
        assert float(page.locator("#answer td").first.inner_text().split(",")[0]) == pytest.approx(x, abs=0.05)
        assert page.locator("#view").is_hidden()
        program.close()
        program = playwright.chromium.launch(executable_path=chromium_path(), args=ARGUMENTS)  # no camera
        page = program.new_page()
        page.goto(str(server.client.base_url))
        page.get_by_role("button", name="Use the camera").click()
        page.get_by_text("The camera cannot be used").wait_for(timeout=30000)
        program.close()


def test_metrics_can_be_parsed(server, jpeg):
    server.localize(jpeg)
    server.client.get("/none%22%0A")
    text = server.client.get("/metrics").text
    families = re.findall(r"^# TYPE (\w+) (counter|gauge|histogram)$", text, re.MULTILINE)
    for line in text.splitlines():
        assert line.startswith(("# HELP ", "# TYPE ")) or SAMPLE.match(line), line
        assert line.startswith("#") or any(line.startswith(name) for name, _ in families)
    values = server.metrics()
    buckets = [value for name, value in values.items() if name.startswith("lazyloc_request_seconds_bucket")]
    assert buckets == sorted(buckets) and buckets[-1] == values["lazyloc_request_seconds_count"] > 0
    assert values['lazyloc_requests_total{path="other",status="404"}'] >= 1
    assert values['lazyloc_results_total{status="LOCALIZED"}'] >= 1
    assert all(name.startswith("lazyloc_") for name in values)


def test_every_status_is_in_the_openapi_document(server):
    """The paths of the document are those of the service, and say what can go wrong."""
    document = server.client.get("/openapi.json").json()
    assert set(document["paths"]) == {"/healthz", "/localize", "/metrics", "/reload", *geopose.PATHS}
    operation = document["paths"]["/localize"]["post"]
    assert set(operation["responses"]) == {"200", "400", "408", "413", "415", "422", "503", "504"}
    assert "multipart/form-data" in operation["requestBody"]["content"]
    assert server.client.get("/healthz").json() == {"status": "ok"}
    for path in ("/docs", "/redoc"):  # whose pages load from elsewhere
        assert server.client.get(path).status_code == 404


def test_openapi_document_has_the_fields_that_are_accepted(server, photos, jpeg):
    document = server.client.get("/openapi.json").json()
    parameters = document["paths"]["/localize"]["post"]["parameters"]
    patterns = {parameter["name"]: parameter["schema"]["pattern"] for parameter in parameters}
    assert set(patterns) == {"camera", "position", "session"}  # gravity needs an option
    for name, text, is_valid in (
        ("camera", photos.camera_words, True),
        ("camera", "PINHOLE,480,360,400,400,240,180", True),
        ("camera", "PINHOLE 480 360 400 240 180", False),
        ("camera", "PINHOLE 480 360 400 0 240 180", False),
        ("camera", "PINHOLE 0 360 400 400 240 180", False),
        ("camera", "NONE 480 360 400 400 240 180", False),
        ("camera", "EQUIRECTANGULAR 640 320 640 320", True),
        ("position", "1 2 3 0.5", True),
        ("position", "-1 2.5 +3 0.5 1 2", True),
        ("position", "1 2 3 1 0 0 1 -0 1", True),
        ("position", "1 2 3 0", False),
        ("position", "1 2 3 -1", False),
        ("position", "1 2 3 1 1", False),
        ("session", "phone-7", True),
        ("session", "", False),
    ):
        assert bool(re.search(patterns[name], text)) == is_valid, text
        assert server.localize(jpeg, params={name: text}).status_code == (200 if is_valid else 422), text


def test_gravity_is_in_the_document_if_the_service_knows_what_up_is(photos, jpeg):
    with serving(photos, "--LazyLocalizer.world_up", "0,0,1") as server:
        parameters = server.client.get("/openapi.json").json()["paths"]["/localize"]["post"]["parameters"]
        (pattern,) = (parameter["schema"]["pattern"] for parameter in parameters if parameter["name"] == "gravity")
        for text, is_valid in (("0 1 0.1 2", True), ("0 0 0 2", False), ("0 1 0 0", False), ("0 1 0", False)):
            assert bool(re.search(pattern, text)) == is_valid, text
            assert server.localize(jpeg, params={"gravity": text}).status_code == (200 if is_valid else 422), text


def test_full_queue_and_slow_senders(photos, jpeg):
    """One localization at a time, one photo that waits: of eight at once, some are refused, and none is lost."""
    words = ["--max_queue", 1, "--max_seconds", 5, "--max_megabytes", 1]
    with serving(photos, *words, num_threads=1) as server, concurrent.futures.ThreadPoolExecutor(8) as threads:
        slow = [server.connect() for _ in range(3)]
        for connection in slow:  # senders that stop do not take the place of others
            connection.sendall(b"POST /localize HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\n" + jpeg[:500])
        start = time.monotonic()
        answers = list(threads.map(lambda _: httpx.post(f"{server.client.base_url}/localize", content=jpeg), range(8)))
        assert {answer.status_code for answer in answers} == {200, 503}
        assert len({answer.json()["position"][0] for answer in answers if answer.status_code == 200}) == 1
        for answer in answers:
            if answer.status_code == 503:
                assert_one_line(answer, 503, "too many photos are waiting")
                assert int(answer.headers["Retry-After"]) >= 1
        for connection in slow:
            assert connection.recv(1000).startswith(b"HTTP/1.1 408 ")
            connection.close()
        assert 4 < time.monotonic() - start < 30


def test_bytes_in_memory_are_bounded(photos):
    """Two photos of a megabyte have a place in memory; what three senders begin is too much."""
    words = ["--max_queue", 1, "--max_seconds", 10, "--max_megabytes", 1]
    with serving(photos, *words, num_threads=1) as server:
        connections = [server.connect() for _ in range(3)]
        for connection in connections:
            connection.sendall(b"POST /localize HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000\r\n\r\n")
        for connection in connections:
            connection.sendall(bytes(900_000))
        server.wait_until('lazyloc_requests_total{path="/localize",status="503"}', 1)
        assert server.metrics()["lazyloc_received_bytes"] <= 2_000_000
        for connection in connections:
            connection.close()
        server.wait_until("lazyloc_received_bytes", 0)


def test_tokens(photos, jpeg, tmp_path):
    tokens = tmp_path / "tokens"
    tokens.write_text("# of phones\nfirst-token\n\nsecond/token=\n")
    with serving(photos, "--tokens", tokens) as server:
        for headers in (
            {},
            {"Authorization": "Bearer first-toke"},
            {"Authorization": "Bearer first-token2"},
            {"Authorization": "Bearer"},
            {"Authorization": "Bearer # of phones"},
            {"Authorization": "Basic first-token"},
            {"Authorization": b"Bearer \xff\xfe"},
        ):
            for method, path in (("POST", "/localize"), ("POST", "/reload"), ("GET", "/metrics")):
                answer = server.client.request(method, path, headers=headers)
                assert_one_line(answer, 401, "token")
                assert answer.headers["WWW-Authenticate"] == "Bearer"
        for token in ("first-token", "second/token="):
            answer = server.localize(jpeg, headers={"Authorization": f"Bearer {token}"})
            assert pose_errors(photos, answer)[0] < 0.05
        assert server.client.get("/healthz").status_code == server.client.get("/").status_code == 200
        assert "HTTPBearer" in json.dumps(server.client.get("/openapi.json").json()["paths"]["/localize"])


def send_beginnings(server, jpeg, count):
    """Sends the first 500 bytes of the photo on each of `count` connections, and waits until the service has them."""
    connections = [server.connect() for _ in range(count)]
    for connection in connections:
        connection.sendall(b"POST /localize HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % len(jpeg))
        connection.sendall(jpeg[:500])
    server.wait_until("lazyloc_received_bytes", count * 500)
    return connections


def test_sigterm_lets_requests_end(photos, jpeg):
    """Photos that run, wait or still arrive are answered; new connections are refused."""
    server = Server(photos, num_threads=1)
    connections = send_beginnings(server, jpeg, 4)
    server.client.close()
    for connection in connections[:2]:
        connection.sendall(jpeg[500:])
    server.process.send_signal(signal.SIGTERM)
    end = time.monotonic() + 10
    with pytest.raises(ConnectionRefusedError):
        while time.monotonic() < end:
            with contextlib.suppress(ConnectionResetError):  # accepted just before
                server.connect().close()
    for connection in connections[2:]:
        connection.sendall(jpeg[500:])
    for connection in connections:
        with connection, http.client.HTTPResponse(connection) as answer:
            answer.begin()
            assert answer.status == 200 and json.load(answer)["cam_from_world"]
    _, errors = server.process.communicate(timeout=MAX_SECONDS)
    assert (server.process.returncode, errors) == (0, "")


def test_crash_ends_requests_at_once_and_a_new_start_answers(photos, jpeg):
    """As systemd and docker start it again: on the same port, while connections of before are still known."""
    server = Server(photos, num_threads=1)
    connections = send_beginnings(server, jpeg, 3)
    server.process.send_signal(signal.SIGSEGV)
    for connection in connections:
        with connection, contextlib.suppress(ConnectionResetError):
            assert connection.recv(1000) == b""
    server.client.close()
    _, errors = server.process.communicate(timeout=MAX_SECONDS)
    assert server.process.returncode == -signal.SIGSEGV, errors
    with serving(photos, "--port", server.port) as again:
        assert again.port == server.port and pose_errors(photos, again.localize(jpeg))[0] < 0.05


@pytest.fixture
def growing(photos, tmp_path):
    """Returns the scene with a model that may be changed."""
    copy = type(photos)(tmp_path, photos.poses)
    copy.model_path.mkdir()
    for path in photos.model_path.iterdir():
        (copy.model_path / path.name).write_bytes(path.read_bytes())
    os.link(photos.database_path, copy.database_path)
    return copy


def images_file(scene):
    (path,) = scene.model_path.glob("images.*")
    return path


def test_reload_takes_the_model_of_now(growing, jpeg):
    images = images_file(growing)
    content = images.read_bytes()
    server = Server(growing)
    before = server.localize(jpeg).json()
    images.write_bytes(b"")
    assert_one_line(server.client.post("/reload"), 409, "the database before stays in use")
    assert server.localize(jpeg).json()["position"] == before["position"]
    images.write_bytes(content)
    assert server.client.post("/reload").json() == {"status": "ok"}
    assert server.localize(jpeg).json()["position"] == before["position"]
    assert server.end() == (0, "lazyloc serve: the database is reloaded\n")


def test_changed_model_takes_effect_between_requests(growing, photos, jpeg):
    """Each answer is by the model before or by the one after; a broken file changes nothing until it is whole."""
    server = Server(growing)
    before = np.array(server.localize(jpeg).json()["position"])
    model = read_model(growing.model_path)
    shift = np.array([100.0, -200.0, 50.0])
    moved = [
        Image(
            name,
            image.camera_id,
            Pose.from_centre(image.pose.rotation, image.pose.cam_in_world + shift),
            image.image_id,
        )
        for name, image in model.images.items()
    ]
    images_file(growing).write_bytes(b"")
    assert "the database before stays in use" in server.process.stderr.readline()
    assert np.array_equal(server.localize(jpeg).json()["position"], before)
    write_model(growing.model_path, model.cameras, moved, binary=images_file(growing).suffix == ".bin")
    shifts, end = [], time.monotonic() + 60
    while time.monotonic() < end and not any(shifts):
        answer = server.localize(jpeg)
        assert answer.status_code == 200
        shifts.append(np.linalg.norm(np.array(answer.json()["position"]) - before - shift) < 0.01)
        assert shifts[-1] or np.array_equal(answer.json()["position"], before)
    assert shifts[-1]
    assert server.end() == (0, "lazyloc serve: the database is reloaded\n")


def test_folder_of_a_run_is_a_model(photos, tmp_path):
    """The output folder of lazyloc run names its model, photos and index."""
    (tmp_path / "steps.json").write_text("{}")
    for name in ("database_path", "model_path"):
        path = getattr(photos, name)
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "images").mkdir()
    options, settings = serve.parse_arguments([str(tmp_path), "--LazyLocalizer.num_threads=3"])
    with Source(options.model, options.database_path, settings).open().localizer as localizer:
        assert localizer.num_threads == 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{}/none"], "none: does not exist"),
        (["{model}", "--database_path", "{}/none"], "none: does not exist"),
        (["{model}", "--tokens", "{}/none"], "none: cannot be read"),
        (["{model}", "--tokens", "{}/empty"], "empty: contains no token"),
        (["{model}", "--tokens", "{}/bad"], "bad, line 2: a token must be printable ASCII without blanks"),
        (["{model}", "--max_megabyte", "1"], "unknown option --max_megabyte; the nearest is --max_megabytes"),
        (["{model}", "--SiftExtraction.first_octave"], "a value is missing"),
        (["{model}", "--LazyLocalizer.seed", "1", "--LazyLocalizer.seed=2"], "--LazyLocalizer.seed is given twice"),
        (["{model}", "more"], "unknown argument more"),
        (["{model}", "--port", "65536"], "--port"),
        (["{model}", "--max_queue", "0"], "--max_queue"),
        (["{model}", "--host", "192.0.2.1", "--tokens", "{}/good"], "--host 192.0.2.1"),
        (["{model}", "--port", "{port}"], "Address already in use"),
    ],
)
def test_bad_options_are_one_line(photos, words, message, capsys, tmp_path):
    (tmp_path / "empty").write_text("# none\n")
    (tmp_path / "bad").write_text("good\nnot good\n")
    (tmp_path / "good").write_text("good\n")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = [word.format(tmp_path, model=photos.model_path, port=port) for word in words]
        assert serve.main(words) == 1
    error = capsys.readouterr().err
    assert message in error.splitlines()[-1] and "Traceback" not in error


def test_open_host_without_tokens_is_warned_of(photos):
    command = [sys.executable, "-m", "colmap_lazyloc", "serve", photos.model_path, "--host", "0.0.0.0", "--port", "0"]
    process = subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    assert "without --tokens" in process.stderr.readline() and "http://0.0.0.0:" in process.stderr.readline()
    process.terminate()
    assert process.wait(timeout=60) == 0

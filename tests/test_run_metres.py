"""Metres for photos without poses: by their GPS, or by a distance between two cameras or two points."""

import csv
import re
import shutil

import numpy as np
import PIL.Image
import PIL.ImageOps
import pycolmap
import pytest

import photo_scene
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.demo import survey
from colmap_lazyloc.demo.scene import build_scene, write_images
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.localizer import Localizer
from colmap_lazyloc.model import POINT2D, Camera, Image, Model, read_model, write_model
from colmap_lazyloc.points import Points
from colmap_lazyloc.pose_formats.control_points import Mark
from colmap_lazyloc.pose_formats.exif_gps import GpsPosition, in_local_frame, read_photos
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import ORIENTATION, photo_size
from colmap_lazyloc.poses import Pose, look_at, read_poses
from colmap_lazyloc.project.alignment import NotAlignedError, align_to_positions
from colmap_lazyloc.project.alignment_errors import estimate_errors
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.distance import MARK_STDDEV_PX, End, locate
from colmap_lazyloc.project.folder import Folder
from colmap_lazyloc.project.level import find_level
from colmap_lazyloc.project.photos import stored_pixel
from colmap_lazyloc.pycolmap_types import image_from_cam
from colmap_lazyloc.results import read_geodetic, read_results
from report_pages import ReportPage

ORIGIN = survey.ORIGIN
GPS_NOISE_M, OUTLIER_M = 0.5, 40.0
MODEL_ERROR = 0.025  # of the mapper's model of the courtyard: its focal lengths are 1.4 % too long
XMP = (
    b'http://ns.adobe.com/xap/1.0/\0<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description drone-dji:RtkStdLon="%.4f"'
    b' drone-dji:RtkStdLat="%.4f"><drone-dji:RtkStdHgt>%.4f</drone-dji:RtkStdHgt></rdf:Description></x:xmpmeta>'
)


class Survey:
    """A model in units of its own, of cameras in a plane, and where these were."""

    def __init__(self, folder, colmap, centres, rotations=None):
        self.folder, self.colmap, self.centres = Folder(folder / "out"), colmap, np.array(centres, float)
        self.folder.path.mkdir()
        self.source = folder / "sparse"
        rotation = look_at(np.zeros(3), np.array([0.3, 0.4, 1.0]), (0, -1, 0), roll_deg=30)
        self.rotations = [rotation] * len(self.centres) if rotations is None else rotations
        images = [
            Image(f"database/{i:02}.jpg", 1, Pose.from_centre(turn @ rotation.T, rotation @ centre * 0.1 + 7), i + 1)
            for i, (centre, turn) in enumerate(zip(self.centres, self.rotations))
        ]
        write_model(self.source, {1: Camera("PINHOLE", 640, 480, (500.0, 500.0, 320.0, 240.0))}, images)

    def align(self, positions, accuracy_m=None):
        places = ORIGIN.to_geodetic(np.array(positions, float))
        gps = [GpsPosition(f"database/{i:02}.jpg", *place, 5.0, accuracy_m) for i, place in enumerate(places.tolist())]
        runner = ColmapRunner(self.folder.log)
        return "\n".join(align_to_positions(self.folder, runner, self.colmap, self.source, in_local_frame(gps)))

    def similarity(self):
        """Returns the angle in degrees by which the model is turned, that by which it is tilted, and the ratio of its
        lengths to true ones."""
        poses = [image.cam_from_world for _, image in sorted(read_model(self.folder.model).images.items())]
        turn = poses[0].rotation.T @ self.rotations[0]
        sizes = (np.linalg.norm(places - places.mean(axis=0)) for places in (self.found(poses), self.centres))
        return *np.degrees(np.arccos([(np.trace(turn) - 1) / 2, turn[2, 2]])), np.divide(*sizes)

    @staticmethod
    def found(poses):
        return np.array([pose.cam_in_world for pose in poses])

    def errors(self):
        """Returns the distances of the aligned cameras to where they were."""
        origin = GeoOrigin.read(self.folder.model)
        images = read_model(self.folder.model).images
        centres = np.array([images[name].cam_from_world.cam_in_world for name in sorted(images)])
        return np.linalg.norm(ORIGIN.from_geodetic(*origin.to_geodetic(centres).T) - self.centres, axis=1)


@pytest.fixture
def grid(tmp_path, colmap):
    rng = np.random.default_rng(1)
    places = [(x, y, 30) for x in (0, 20, 40, 60, 80) for y in (0, 20, 40, 60)]
    return Survey(tmp_path, colmap, places + rng.uniform(-3, 3, (20, 3)))


def test_wrong_gps_of_some_photos_is_left_out_and_counted(grid):
    rng = np.random.default_rng(2)
    positions = grid.centres + GPS_NOISE_M * rng.standard_normal((20, 3))
    positions[3] += [OUTLIER_M, 0, 0]
    positions[9] += [0, 12, 5]
    text = grid.align(positions)
    median, beyond, tolerance, degrees, percent = re.search(
        r"of 20 photos: median error (\S+) m, (\d+) beyond (\S+) m, orientation to (\S+) degrees, lengths to (\S+) %$",
        text,
    ).groups()
    assert 0.4 < float(median) < 1.2 and beyond == "2" and float(tolerance) < 5 and float(degrees) < 1
    assert float(percent) < 1
    assert grid.errors().max() < 0.8


def test_accuracies_of_rtk_show_small_errors(grid):
    rng = np.random.default_rng(3)
    positions = grid.centres + 0.02 * rng.standard_normal((20, 3))
    positions[5] += [0.4, 0, 0]
    assert ", 1 beyond 0.1" in grid.align(positions, accuracy_m=0.035)
    assert grid.errors().max() < 0.05


def test_accuracies_that_are_too_good_do_not_refuse_the_alignment(grid):
    rng = np.random.default_rng(4)
    text = grid.align(grid.centres + GPS_NOISE_M * rng.standard_normal((20, 3)), accuracy_m=0.01)
    assert ", none beyond" in text and grid.errors().max() < 0.8


@pytest.mark.parametrize(
    ("centres", "noise_m", "reason"),
    [
        ([(0, 0, 0), (10, 0, 0)], 0.1, "only 2 of its photos have GPS"),
        ([(10 * i, 5 * i, 0.001 * i) for i in range(12)], 0.5, "almost on a line"),
        ([(0.1 * (i % 4), 0.1 * (i // 4), 0) for i in range(12)], 0.2, r"errors of 1 m \(assumed\) leave"),
        ([(40 * (i % 4), 40 * (i // 4), 0) for i in range(12)], 2000.0, "differ by more than"),
    ],
)
def test_gps_that_does_not_fix_the_model(tmp_path, colmap, centres, noise_m, reason):
    place = Survey(tmp_path, colmap, centres)
    positions = place.centres + noise_m * np.random.default_rng(5).standard_normal(place.centres.shape)
    with pytest.raises(NotAlignedError, match=reason):
        place.align(positions)
    assert GeoOrigin.read(place.folder.model) is None


def wander(rng, count, stddev_m, length):
    """Makes errors of GPS in a series of photos, whose correlation falls to 1/e over `length` photos."""
    numbers = np.arange(count)
    correlation = np.exp(-np.abs(numbers[:, None] - numbers) / length)
    return stddev_m * np.linalg.cholesky(correlation) @ rng.standard_normal((count, 3))


def stated(text):
    """Returns the deviations of the orientation in degrees and of the scale that are stated."""
    degrees, percent = re.search(r"orientation to (\S+) degrees, lengths to (\S+) %", text).groups()
    return float(degrees), float(percent) / 100


def bent_walk(count):
    along = np.linspace(0, 80, count)
    return np.stack([along, 8 * np.sin(along / 10), 1.5 + 0.2 * np.cos(along)], axis=1)


def test_errors_of_gps_that_wander_are_stated(tmp_path, colmap):
    """One photo a second, and errors that change within a minute. One of ten walks may be beyond three deviations,
    because the alignment absorbs much of such errors."""
    num_within = 0
    for seed in range(10):
        folder = tmp_path / str(seed)
        folder.mkdir()
        walk = Survey(folder, colmap, bent_walk(40))
        text = walk.align(walk.centres + wander(np.random.default_rng(seed), 40, stddev_m=4, length=60))
        degrees, ratio = stated(text)
        turn_deg, _, scale = walk.similarity()
        num_within += turn_deg < 3 * degrees and abs(scale - 1) < 3 * ratio
        assert degrees < 10 and ratio < 0.1
    assert num_within >= 9


@pytest.mark.parametrize("length", [None, 10, 60, 200])
def test_stated_deviations_of_an_alignment_are_its_errors(length):
    """The median of a squared normal error is 0.455 variances."""
    rng, normalized = np.random.default_rng(7), []
    for _ in range(60):
        centres = bent_walk(40)
        errors = wander(rng, 40, 3, length) if length else rng.standard_normal((40, 3))
        similarity = pycolmap.estimate_sim3d(centres, centres + errors)
        errors = estimate_errors(similarity * centres, centres + errors, 0.1, is_series=True)
        heading = np.degrees(np.arctan2(*(similarity.rotation.matrix()[1::-1, 0])))
        normalized.append([heading / errors.heading_deg, 100 * np.log(similarity.scale) / errors.scale_percent])
    medians = np.median(np.square(normalized), axis=0) / 0.455
    assert np.all((medians > 0.3) & (medians < 2)), medians


def inward(count, radius):
    """Returns centres on a circle, and rotations of cameras that look inward and are level, but for 2 degrees."""
    angles, rng = np.linspace(0, 2 * np.pi, count, endpoint=False), np.random.default_rng(8)
    centres = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(count, 1.6)], axis=1)
    rolls = 2 * rng.standard_normal(count)
    return centres, [
        look_at(centre, np.array([0, 0, 1.0]), (0, 0, -1), roll_deg=r) for centre, r in zip(centres, rolls)
    ]


def test_cameras_say_where_up_is_if_gps_does_not(tmp_path, colmap):
    place = Survey(tmp_path, colmap, *inward(24, radius=3))
    text = place.align(place.centres + wander(np.random.default_rng(9), 24, stddev_m=2, length=8), accuracy_m=5)
    degrees, ratio = stated(text)
    turn_deg, tilt_deg, scale = place.similarity()
    assert "and to the vertical of the cameras: " in text and tilt_deg < 3
    assert turn_deg < 3 * degrees and abs(scale - 1) < 3 * ratio
    _, line = text.splitlines()
    assert re.search(r"known to \d+ degrees, and lengths to \d+ %, because the photos with GPS are within \d", line)
    assert "--control_points" in line and "--scale" in line


def test_good_gps_says_where_up_is(tmp_path, colmap):
    place = Survey(tmp_path, colmap, *inward(24, radius=30))
    text = place.align(place.centres + 0.02 * np.random.default_rng(9).standard_normal((24, 3)), accuracy_m=0.03)
    assert "vertical" not in text and place.similarity()[0] < 0.1 and "\n" not in text


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_up_is_that_of_photos_as_they_are_shown(orientation):
    _, rotations = inward(12, radius=3)
    # Pixels of a photo that is shown turned by 180, 90, -90 degrees are stored with axes that are turned back.
    turns = {1: (1, 0), 3: (-1, 0), 6: (0, 1), 8: (0, -1)}
    cosine, sine = turns[orientation]
    stored_from_shown = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    level = find_level(np.array([stored_from_shown @ rotation for rotation in rotations]), [orientation] * 12)
    assert np.degrees(np.arccos(level.up[2])) < level.stddev_deg < 6


def test_up_is_unknown_if_all_cameras_look_in_one_direction():
    _, rotations = inward(12, radius=3)
    assert find_level(np.array([rotations[0]] * 12), [1] * 12).stddev_deg > 90


def test_photos_are_in_the_order_in_which_they_were_taken():
    gps = [
        GpsPosition(name, 47, 8, 400, 5.0, time=time)
        for name, time in (("a", "2026:05:01 12:00:01.9"), ("b", "2026:05:01 12:00:01.1"), ("c", "."))
    ]
    assert [photo.name for photo in in_local_frame(gps).photos] == ["c", "b", "a"]


# Photos


def write_gps(path, centre, xmp=None):
    survey.write_gps(path, centre)
    if xmp is not None:
        photo = path.read_bytes()
        path.write_bytes(photo[:2] + b"\xff\xe1" + (len(xmp) + 2).to_bytes(2, "big") + xmp + photo[2:])


def test_accuracies_of_photos(tmp_path):
    for name in ("plain", "rtk", "off"):
        PIL.Image.new("RGB", (8, 8)).save(tmp_path / f"{name}.jpg")
    write_gps(tmp_path / "plain.jpg", np.zeros(3))
    write_gps(tmp_path / "rtk.jpg", np.zeros(3), XMP % (0.01, 0.02, 0.04))
    write_gps(tmp_path / "off.jpg", np.zeros(3), XMP % (0, 0, 0))
    found = {photo.name: photo.accuracy_m for photo in read_photos({path.stem: path for path in tmp_path.iterdir()})}
    assert found["plain"] is None and found["off"] is None
    assert found["rtk"] == pytest.approx(np.sqrt(0.01**2 + 0.02**2 + 0.04**2))


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    """Renders a survey whose photos have GPS, one of them a wrong one; returns the folder and the true poses."""
    folder = tmp_path_factory.mktemp("flight")
    rng = np.random.default_rng(6)
    photos, new = survey.make_views(rng)
    rectangles = build_scene(0, texels_per_m=110)
    for name, views in (("photos", photos), ("new", new)):
        write_images(folder / name, rectangles, views, 0, stream=20)
        for index, view in enumerate(views):
            error = GPS_NOISE_M * rng.standard_normal(3)
            if name == "photos" and index == 7:
                error[0] += OUTLIER_M
            write_gps(folder / name / view.name, view.pose.cam_in_world + error)
    return folder, {view.name: view.pose for view in (*photos, *new)}


def test_run_by_gps(flight, colmap, monkeypatch, tmp_path, capsys):
    folder, poses = flight
    monkeypatch.setenv("COLMAP", str(colmap))
    monkeypatch.chdir(tmp_path)
    output = tmp_path / "out"
    words = ["run", "--database_images", folder / "photos", "--queries", folder / "new", "--output", output.name]
    words = [str(word) for word in [*words, "--crs", "EPSG:32632", *photo_scene.SIFT]]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert re.search(r"aligned to the GPS of 15 photos: median error 0\.\d\d m, 1 beyond", printed.err)
    assert "latitude" in printed.out and "x (m)" in printed.out and "4 of 4 queries localized" in printed.out
    for name, place in read_geodetic(output / "localized").items():
        (found,) = ORIGIN.from_geodetic(*np.array(place)[:, None])
        assert np.linalg.norm(found - poses[name.removeprefix("query/")].cam_in_world) < 1.5 * GPS_NOISE_M
    assert all(angle not in ("", None) for angle in angles(output))
    alignment = (output / "model" / "alignment.txt").read_text().strip()
    assert alignment in printed.err
    notes = ReportPage(output / "report.html").summary["notes"]
    assert f"The coordinates of the database images are {alignment}." in notes
    page = (output / "report.html").read_bytes()
    monkeypatch.chdir(folder)
    assert main(["report", str(output)]) == 0
    assert (output / "report.html").read_bytes() == page, "with the photos, the matches, the alignment, the system"
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    assert main(words) == 0
    assert "aligned" not in capsys.readouterr().err, "nothing is done again"


def angles(output):
    """Returns the cells of all angles of the localized queries, and the values in results.jsonl."""
    with (output / "localized" / "positions.csv").open(newline="") as file:
        cells = [row[name] for row in csv.DictReader(file) for name in row if name.endswith("_deg")]
    results = read_results(output / "localized" / "results.jsonl").values()
    names = [f"{angle}{end}" for angle in ("heading", "pitch", "roll") for end in ("_deg", "_stddev_deg")]
    return [*cells, *(result[name] for result in results for name in names)]


@pytest.fixture
def courtyard(photos, colmap, monkeypatch, tmp_path):
    """Returns a function that runs `lazyloc run` without poses on photos without GPS; returns the output folder."""
    monkeypatch.setenv("COLMAP", str(colmap))

    def start(*more, exit_code=0):
        words = ["run", "--database_images", photos.image_path / "database", "--queries", photos.image_path / "query"]
        words += ["--output", tmp_path / "out", *photo_scene.SIFT, *more]
        assert main([str(word) for word in words]) == exit_code
        return tmp_path / "out"

    return start


def test_run_by_a_distance(courtyard, photos, capsys):
    centres = {name: pose.cam_in_world for name, pose in photos.poses.items()}
    output = courtyard()
    assert set(angles(output)) == {"", None}, "it is not known where up is"
    assert (
        "lengths are in units of the model, because no photo has GPS; --scale gives metres" in capsys.readouterr().err
    )
    metres = np.linalg.norm(centres["database/5.png"] - centres["database/0.png"])
    output = courtyard("--scale", "0.png", "5.png", f"{metres}")
    printed = capsys.readouterr()
    assert "mapping" not in printed.err, "only the scale is new"
    assert "scaled by the distance between 0.png and 5.png," in printed.err and "x (m)" in printed.out
    found = {name: pose.cam_in_world for name, pose in read_poses(output / "localized" / "poses.txt").items()}
    assert set(angles(output)) == {"", None}
    with Localizer(output / "database.db", output / "model") as localizer:
        result = localizer.localize_photo(output / "images" / "query" / "0.png")
    assert result.is_localized and result.heading_deg is None
    true, measured = (np.linalg.norm(places["query/0.png"] - places["query/1.png"]) for places in (centres, found))
    assert measured == pytest.approx(true, rel=0.01)


def test_photos_without_a_pose_of_the_mapper_are_named(photos, colmap, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("COLMAP", str(colmap))
    shutil.copytree(photos.image_path / "database", tmp_path / "photos")
    with PIL.Image.open(tmp_path / "photos" / "0.png") as photo:
        PIL.ImageOps.mirror(photo).save(tmp_path / "photos" / "mirrored.png")  # SIFT does not match it
    words = ["run", "--database_images", tmp_path / "photos", "--queries", photos.image_path / "query"]
    words += ["--output", tmp_path / "out", *photo_scene.SIFT]
    assert main([str(word) for word in words]) == 0
    line = "COLMAP's mapper found no pose of 1 of 7 photos, which are not used: database/mirrored.png"
    assert line in capsys.readouterr().err
    warnings = ReportPage(tmp_path / "out" / "report.html").summary["warnings"]
    (warning,) = (warning for warning in warnings if warning["title"] == "Database images without poses")
    assert [item["name"] for item in warning["items"]] == ["database/mirrored.png"]


def test_model_of_few_photos_is_doubted(photos, colmap, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("COLMAP", str(colmap))
    shutil.copytree(photos.image_path / "database", tmp_path / "photos")
    rng = np.random.default_rng(0)
    for index in range(7):
        pixels = rng.integers(0, 255, (90, 120), np.uint8)
        PIL.Image.fromarray(pixels).resize((480, 360)).save(tmp_path / "photos" / f"noise{index}.png")
    words = ["run", "--database_images", tmp_path / "photos", "--queries", photos.image_path / "query"]
    words += ["--output", tmp_path / "out", *photo_scene.SIFT]
    assert main([str(word) for word in words]) == 0
    text = capsys.readouterr().err
    assert "found no pose of 7 of 13 photos" in text and "so few photos may make a wrong model" in text


def test_run_by_marked_points(courtyard, photos, capsys):
    """The points are on the north wall and on its bay."""
    camera, points = photo_scene.CAMERA, np.array([[-1.0, 6.0, 3.5], [2.2, 4.0, 3.0]])
    marks = {
        name: [
            f"{name}.png:{x:.0f},{y:.0f}"
            for x, y in image_from_cam(camera, photos.poses[f"database/{name}.png"](points))
        ]
        for name in "0235"
    }
    courtyard()
    metres, stddevs = np.linalg.norm(points[1] - points[0]), []
    for ends in (marks["2"], map("+".join, zip(marks["0"], marks["2"], marks["5"])), (marks["2"][0], marks["3"][1])):
        capsys.readouterr()
        output = courtyard("--scale", *ends, f"{metres}m")
        printed = capsys.readouterr()
        assert "mapping" not in printed.err and "x (m)" in printed.out
        stddev = re.search(r"standard deviation (\S+) m \((\S+) %\) from the marks", printed.err)
        stddevs.append(float(stddev[2]) / 100)
        assert float(stddev[1]) == pytest.approx(metres * stddevs[-1], rel=0.1)
        found = {name: pose.cam_in_world for name, pose in read_poses(output / "localized" / "poses.txt").items()}
        true = np.linalg.norm(photos.poses["query/0.png"].cam_in_world - photos.poses["query/1.png"].cam_in_world)
        error = abs(np.linalg.norm(found["query/0.png"] - found["query/1.png"]) / true - 1)
        assert error < 3 * stddevs[-1] + MODEL_ERROR
    assert stddevs[1] < stddevs[0] < 0.05, "more marks are more accurate"
    courtyard("--scale", marks["2"][0], "2.png:38,331", "4.2", exit_code=1)
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "--scale" in line]
    assert (
        "--scale 2.png:38,331: the depth is unknown, because the " in line
        and "mark the point in a second photo" in line
    )


class Table:
    """A model of two photos of a table's top in front of a floor."""

    CAMERA = Camera("PINHOLE", 640, 480, (500.0, 500.0, 320.0, 240.0))
    CORNER = (1.0, 0.0, 4.2)

    def __init__(self):
        grid = np.linspace(-0.9, 1.0, 20)
        top = [(x, y, 4 + 0.2 * x) for x in grid for y in grid[4:-4]]
        floor = [(2 * x, 2 * y, 8.0) for x in grid + 2.05 for y in grid[4:-4]]
        self.points = Points(np.arange(len(top) + len(floor)), np.array(top + floor))
        self.poses = {name: Pose(np.eye(4)[0], np.array([-x, 0, 0])) for name, x in (("a", -0.4), ("b", 0.6))}
        images = {}
        for number, (name, pose) in enumerate(self.poses.items()):
            keypoints = np.zeros(len(self.points), POINT2D)
            keypoints["x"], keypoints["y"] = image_from_cam(self.CAMERA, pose(self.points.xyz)).T
            keypoints["point3d_id"] = self.points.ids
            images[name] = Image(name, 1, pose, number, keypoints)
        self.model = Model({1: self.CAMERA}, images)

    def locate(self, place, names, shift_px=(0, 0)):
        """Finds a place that is marked in photos; `shift_px`: the error of the last mark."""
        pixels = [image_from_cam(self.CAMERA, self.poses[name](np.array([place], float)))[0] for name in names]
        pixels[-1] = pixels[-1] + shift_px
        marks = tuple(Mark(name, "table", tuple(pixel)) for name, pixel in zip(names, pixels))
        return locate(End("table", marks=marks), self.model, self.points)


def test_mark_in_one_photo_is_on_the_surface_around_it():
    table, top = Table(), (0.33, 0.21, 4 + 0.2 * 0.33)
    found = table.locate(top, "a")
    assert np.allclose(found.xyz, top, atol=1e-6)
    across = np.sqrt(np.diag(found.covariance)[:2])
    assert np.allclose(across, MARK_STDDEV_PX * top[2] / 500, rtol=0.1)
    assert np.trace(table.locate(top, "ab").covariance) < np.trace(found.covariance)


@pytest.mark.parametrize(
    ("place", "names", "shift_px", "message"),
    [
        (Table.CORNER, "a", (0, 0), "are at different depths: mark the point in a second photo, too"),
        ((-2, -1.5, 4), "a", (0, 0), "the model has 0 points within 64 pixels of the mark, and 12 are needed"),
        ((-1.8, -1.5, 4), "ab", (0, 120), "the rays of these marks do not meet or are almost parallel"),
    ],
)
def test_mark_without_a_depth_is_refused(place, names, shift_px, message):
    with pytest.raises(InputError, match=f"^--scale table: .*{message}"):
        Table().locate(place, names, shift_px)


def test_corner_that_is_marked_in_two_photos_is_not_on_the_floor():
    found = Table().locate(Table.CORNER, "ab")
    stddev = np.sqrt(found.covariance[2, 2])
    assert abs(found.xyz[2] - Table.CORNER[2]) < stddev < 0.1


def test_marks_that_contradict_each_other_are_uncertain():
    table, top = Table(), (0.33, 0.21, 4 + 0.2 * 0.33)
    good, bad = (np.trace(table.locate(top, "ab", (0, error_px)).covariance) for error_px in (1, 30))
    assert bad > 4 * good


@pytest.mark.parametrize(("noise_ratio", "has_background"), [(1, False), (3, False), (1, True)])
@pytest.mark.parametrize("num_photos", [2, 3, 5])
def test_stated_deviation_of_marks_is_their_scatter(num_photos, noise_ratio, has_background):
    """The points of the model next to the marks are 4 m behind the place, or there are none."""
    noise_px = noise_ratio * MARK_STDDEV_PX
    rng, camera, place = np.random.default_rng(1), Table.CAMERA, np.array([0.3, 0.2, 4.0])
    wall = np.array([(x, y, 8) for x in np.linspace(-3, 3, 40) for y in np.linspace(-3, 3, 40)])
    points = Points(np.arange(len(wall)), wall if has_background else wall + [1e4, 0, 0])
    images = {}
    for i, x in enumerate(np.linspace(-0.6, 0.6, num_photos)):
        pose = Pose(np.eye(4)[0], np.array([-x, -0.1 * (i % 2), 0]))
        keypoints = np.zeros(len(points), POINT2D)
        keypoints["x"], keypoints["y"] = image_from_cam(camera, pose(points.xyz)).T
        keypoints["point3d_id"] = points.ids
        images[str(i)] = Image(str(i), 1, pose, i, keypoints)
    found = []
    for _ in range(100):
        pixels = {name: image_from_cam(camera, image.pose(place[None]))[0] for name, image in images.items()}
        marks = [Mark(name, "", tuple(pixel + noise_px * rng.normal(size=2))) for name, pixel in pixels.items()]
        found.append(locate(End("", marks=tuple(marks)), Model({1: camera}, images), points))
    scatter = np.sqrt(np.mean([(each.xyz - place) ** 2 for each in found], axis=0))
    stated = np.sqrt(np.mean([np.diag(each.covariance) for each in found], axis=0))
    assert np.all((stated / scatter > 0.7) & (stated / scatter < 1.4)), stated / scatter


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_marks_are_in_the_photo_as_viewers_show_it(tmp_path, orientation, name):
    """The project turns only mirror images upright."""
    stored = np.zeros((6, 9), np.uint8)
    stored[1, 7] = 255
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    for each in {name, "a.png"}:
        PIL.Image.fromarray(stored).save(tmp_path / each, exif=exif)
    with PIL.Image.open(tmp_path / "a.png") as photo:
        shown = np.array(PIL.ImageOps.exif_transpose(photo))
    ((row, column),) = np.argwhere(shown)
    pixel = stored_pixel("--scale", tmp_path / name, column + 0.5, row + 0.5)
    assert pixel == ((column + 0.5, row + 0.5) if orientation in (2, 4, 5, 7) else (7.5, 1.5))
    assert photo_size(tmp_path / name) == (9, 6)
    height, width = shown.shape
    with pytest.raises(InputError, match=f"--scale: is outside of the photo, which has {width} x {height} pixels"):
        stored_pixel("--scale", tmp_path / name, width + 1, 1)


def write_control_points(folder, photos, places):
    """Writes control points, and their marks in the database images."""
    points = ["point,x,y,z", *(f"{name},{','.join(map(str, place))}" for name, place in places.items())]
    marks = ["photo,point,x,y"]
    for image in photos.database_names:
        for point, place in places.items():
            x, y = image_from_cam(photo_scene.CAMERA, photos.poses[image](np.array([place], float)))[0]
            if 0 < x < photo_scene.CAMERA.width and 0 < y < photo_scene.CAMERA.height:
                marks.append(f"{image.removeprefix('database/')},{point},{x:.17g},{y:.17g}")
    for name, lines in (("points.csv", points), ("marks.csv", marks)):
        (folder / name).write_text("\n".join(lines) + "\n")
    return folder / "points.csv", folder / "marks.csv"


def files_of(folder):
    """Returns what the files of a run's model, results and report hold."""
    paths = [*folder.glob("model/*"), *folder.glob("localized/*"), folder / "report.html", folder / "steps.json"]
    return {path: path.read_bytes() for path in paths if path.is_file()}


def test_run_by_control_points(courtyard, photos, tmp_path, capsys):
    places = {f"P{i}": place for i, place in enumerate([(-2, 3, 0), (2, 3, 0), (0, 4, 2), (-1, 5, 1), (1.5, 4, 1)])}
    files = write_control_points(tmp_path, photos, places)
    files[0].write_text(files[0].read_text().replace("P3,-1,", "P3,-1.5,"))
    output = courtyard("--control_points", *files)
    printed = capsys.readouterr()
    assert "aligned to the 5 control points: median error 0.0" in printed.err and "1 beyond" in printed.err
    assert re.search(r"control point 'P3' is left out, because it is off by 0\.\d+ m", printed.err)
    assert "x (m)" in printed.out
    for name, pose in read_poses(output / "localized" / "poses.txt").items():
        assert np.linalg.norm(pose.cam_in_world - photos.poses[name].cam_in_world) < 0.1
    files = write_control_points(tmp_path, photos, {"P0": (-2, 3, 0), "P1": (2, 3, 0)})
    courtyard("--control_points", *files, exit_code=1)
    named = capsys.readouterr().err
    assert "--control_points: 2 points have marks in two or more photos of " in named
    assert "without --poses, at least 3 points that are not on one line are needed" in named
    before = files_of(output)
    for height in (0.03, 0):
        places = {f"P{i}": (x, 3, height * i * i) for i, x in enumerate((-2, 0, 2))}
        courtyard("--control_points", *write_control_points(tmp_path, photos, places), exit_code=1)
        assert "--control_points: the control points are almost on a line" in capsys.readouterr().err
        assert files_of(output) == before, "what the first run has made stays"


def test_run_by_positions_without_rotations(courtyard, photos, tmp_path, capsys):
    names = [name.removeprefix("database/") for name in photos.database_names]
    centres = np.array([photos.poses[name].cam_in_world for name in photos.database_names])
    table = tmp_path / "survey.csv"
    rows = (f"{name},{a!r},{b!r},{c!r},0.02\n" for name, (a, b, c) in zip(names, ORIGIN.to_geodetic(centres).tolist()))
    table.write_text("".join(["name,latitude,longitude,altitude,accuracy\n", *rows]))
    output = courtyard("--poses", table, "--crs", "EPSG:32632")
    printed = capsys.readouterr()
    assert "aligned to the positions of 6 photos: median error 0.0" in printed.err and "latitude" in printed.out
    for name, place in read_geodetic(output / "localized").items():
        (found,) = ORIGIN.from_geodetic(*np.array(place)[:, None])
        assert np.linalg.norm(found - photos.poses[name].cam_in_world) < 0.05
    rows = [f"{name} {x!r} {y!r} {z!r}" for name, (x, y, z) in zip(names, centres.tolist())]
    table.write_text("\n".join(["name x y z stddev", *(f"{row} 0.02" for row in rows)]))
    courtyard("--poses", table)
    printed = capsys.readouterr()
    assert "mapping" not in printed.err and "x (m)" in printed.out and "latitude" not in printed.out
    for name, pose in read_poses(output / "localized" / "poses.txt").items():
        assert np.linalg.norm(pose.cam_in_world - photos.poses[name].cam_in_world) < 0.05
    table.write_text("\n".join(rows))  # as COLMAP's model_aligner takes them
    courtyard("--poses", table)
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "only known to" in line)
    assert re.search(r"only known to \d+ degrees, .*errors of 1 m \(assumed\) are too large", line)
    warning = ReportPage(output / "report.html").summary["warnings"][0]
    assert warning["title"] == "Orientation or lengths are inaccurate"
    assert warning["items"][0]["text"] == line.removeprefix("lazyloc run: ")
    table.write_text("\n".join(rows[:2]))
    courtyard("--poses", table, exit_code=1)
    assert "--poses: only 2 of its photos have positions" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--poses", "PHOTOS", "--poses_format", "exif", "--camera_axes", "opengl"],
            "--camera_axes has no effect on pos",
        ),
        (
            ["--poses", "PHOTOS", "--poses_format", "exif", "--scale", "0.png", "5.png", "2"],
            "--scale has no effect with",
        ),
        (["--poses", "PHOTOS", "--poses_format", "exif", "--panoramas", "all"], "panoramas need rotations, too"),
        (["--poses", "PHOTOS", "--poses_format", "exif"], "images/database: has no photo with GPS"),
        (["--poses", "PHOTOS/0.png", "--poses_format", "exif"], "0.png: is not a folder of photos"),
        (["--scale", "0.png", "photos/5.png", "2"], "is not in --database_images; the nearest is 5.png"),
        (["--scale", "0.png", "55.png", "2"], "--scale 55.png: is not in --database_images; the nearest is 5.png"),
        (["--scale", "0.png", "0.png", "2"], "expected two different photos or points"),
        (["--scale", "0.png:9,8", "0.png:9,8", "2"], "expected two different photos or points"),
        (["--scale", "0.png:9,8+1.png:7,6", "1.png:7.0,6+0.png:9,8", "2"], "expected two different photos or points"),
        (["--scale", "", "0.png", "2"], "expected PHOTO, PHOTO:x,y, or a point in several photos"),
        (["--scale", "0.png:9,8", "5.png:500,8", "2"], "--scale 5.png:500,8: is outside of the photo, which has 480 x"),
        (["--scale", "0.png:9,8+1.png:9,-8", "5.png", "2"], "--scale 1.png:9,-8: is outside of the photo"),
        (["--scale", "0.png", "55.png:9,8", "2"], "--scale 55.png: is not in --database_images; the nearest is 5.png"),
        (["--scale", "0.png", "5.png:9", "2"], "--scale 5.png:9: expected PHOTO, PHOTO:x,y, or a point in several"),
        (["--scale", "0.png", "5.png:9,8+4.png", "2"], "--scale 5.png:9,8+4.png: expected PHOTO, PHOTO:x,y, or"),
        (["--scale", "0.png", "5.png:9,8+5.png:9,9", "2"], "marks the point twice in 5.png"),
        (["--scale", "0.png", "5.png", "-2"], "--scale: expected a distance in metres, found '-2'"),
        (["--scale", "0.png", "5.png", "far"], "--scale: expected a distance in metres, found 'far'"),
        (["--scale", "0.png", "5.png", "2", "--poses", "MODEL"], "--scale has no effect with --poses"),
        (
            ["--scale", "0.png", "5.png", "2", "--control_points", "POINTS"],
            "--control_points has no effect with --scale",
        ),
        (["--scale", "0.png", "5.png", "2", "--panoramas", "all"], "--scale has no effect on panoramas"),
        (["--scale", "0.png", "5.png", "2", "--crs", "EPSG:32632"], "--crs has no effect with --scale"),
        (["--crs", "EPSG:0"], "--crs EPSG:0"),
        (["--crs", "EPSG:32632"], "--crs EPSG:32632 needs --poses, --control_points, or 3 database images with GPS"),
    ],
)
def test_bad_options_are_one_line_before_any_work(courtyard, photos, words, message, tmp_path, capsys):
    paths = {"MODEL": photos.model_path, "PHOTOS": photos.image_path / "database"}
    for name, path in paths.items():
        words = [word.replace(name, str(path)) for word in words]
    courtyard(*words, exit_code=1)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and message in lines[0]
    assert not (tmp_path / "out").exists()

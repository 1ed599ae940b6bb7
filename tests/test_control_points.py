"""Control points: files of all kinds, and what they show about poses."""

import csv
import io
import json

import numpy as np
import pytest

from colmap_lazyloc.__main__ import main
from colmap_lazyloc.model import Camera, Image, write_model
from colmap_lazyloc.pose_formats.geo import GeoOrigin, find_crs, from_geodetic
from colmap_lazyloc.poses import Pose, look_at
from colmap_lazyloc.pycolmap_types import image_from_cam
from colmap_lazyloc.results import read_control_residuals

CAMERA = Camera("SIMPLE_RADIAL", 640, 480, (500.0, 320.0, 240.0, -0.02))
ORIGIN = GeoOrigin(47.3769, 8.5417, 408.0)
POINTS = {"P1": (-2.0, -1.0, 0.0), "P2": (1.5, -1.5, 0.3), "P3": (0.2, 1.8, 0.1), "P4": (-1.0, 1.0, 1.0)}
SHIFT = np.array([0.10, -0.05, 0.02])  # of the poses of the new photos
CENTRES = {
    "database/old0.jpg": (-3.0, -2.0, 9.0),
    "database/old1.jpg": (0.0, -2.0, 9.5),
    "database/old2.jpg": (3.0, -1.0, 9.0),
    "query/new0.jpg": (-2.0, 2.0, 8.5),
    "query/new1.jpg": (2.0, 2.0, 9.0),
}


class Run:
    """Results of lazy_localizer with a model, and exact marks of all points in all photos."""

    def __init__(self, folder):
        self.folder, self.results = folder, folder / "results"
        true = {name: _look_down(centre) for name, centre in CENTRES.items()}
        self.marks = {
            (name.rpartition("/")[2], point): image_from_cam(CAMERA, pose(np.array([place])))[0]
            for name, pose in true.items()
            for point, place in POINTS.items()
        }
        found = {name: _moved(pose) if name.startswith("query/") else pose for name, pose in true.items()}
        images = [Image(name, 1, pose, index) for index, (name, pose) in enumerate(found.items(), 1)]
        write_model(self.results / "model", {1: CAMERA}, images)
        lines = [_result(name, pose) for name, pose in found.items() if name.startswith("query/")]
        lines.append({"name": "query/lost.jpg", "status": "TOO_FEW_TRACKS", "cam_from_world": None})
        (self.results / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))

    def write(self, name, *lines):
        path = self.folder / name
        path.write_text("".join(f"{line}\n" for line in lines))
        return path

    def tables(self, points=POINTS, header="point,x,y,z"):
        rows = [",".join([name, *(repr(float(value)) for value in place)]) for name, place in points.items()]
        marks = [f"{photo},{point},{x!r},{y!r}" for (photo, point), (x, y) in self.marks_as_numbers()]
        return self.write("points.csv", header, *rows), self.write("marks.csv", "photo,point,x,y", *marks)

    def marks_as_numbers(self):
        return [(key, pixel.tolist()) for key, pixel in self.marks.items()]

    def compare(self, capsys, *words):
        """Returns the rows of the table by point and set of photos, and the other lines."""
        assert main(["control_points", str(self.results), *map(str, words)]) == 0
        output = capsys.readouterr()
        self.lines = output.err
        table, _, text = output.out.partition("\n\n")
        return {(row["point"], row["photos"]): row for row in csv.DictReader(io.StringIO(table))}, text


def _look_down(centre):
    return Pose.from_centre(look_at(np.array(centre), np.array([centre[0] / 3, centre[1] / 3, 0]), (0, -1, 0)), centre)


def _moved(pose):
    return Pose.from_centre(pose.rotation, pose.cam_in_world + SHIFT)


def _result(name, pose):
    fields = {"qvec": pose.qvec.tolist(), "tvec": pose.tvec.tolist()}
    return {"name": name, "status": "LOCALIZED", "cam_from_world": fields}


@pytest.fixture
def run(tmp_path):
    return Run(tmp_path)


def assert_shift_found(rows, text, columns=("dx", "dy", "dz"), tolerance=1e-3):
    for point in POINTS:
        for photos, error, marks in (("database", np.zeros(3), 3), ("new", SHIFT, 2)):
            row = rows[point, photos]
            assert int(row["marks"]) == marks
            assert np.allclose([float(row[column]) for column in columns], error, atol=tolerance)
        assert float(rows[point, "database"]["error_px"]) < 0.05 < 2 < float(rows[point, "new"]["error_px"])
    assert "shift of the new photos, by 4 points: 0.1000 -0.0500 0.0200" in text


def test_tables(run, capsys):
    assert_shift_found(*run.compare(capsys, *run.tables()))


def test_points_without_coordinates_show_the_shift(run, capsys):
    _, marks = run.tables()
    rows, text = run.compare(capsys, marks)
    assert rows["P1", "database"]["dx"] == "" and float(rows["P1", "new"]["error_px"]) < 0.05
    assert "shift of the new photos, by 4 points: 0.1000 -0.0500 0.0200 units, standard deviation 0.0000" in text


def test_summary_counts_the_points_whose_error_is_known(run, capsys):
    """A place needs marks in two photos."""
    kept = [("new0.jpg", "P1"), ("new1.jpg", "P1"), *(("new0.jpg", point) for point in ("P2", "P3", "P4"))]
    old = [key for key in run.marks if key[0].startswith("old") and key != ("old0.jpg", "P1")]
    run.marks = {key: run.marks[key] for key in [*old, *kept]}
    _, text = run.compare(capsys, *run.tables())
    assert text.startswith("database photos: 4 points, mean error ") and "mean error of 4" not in text
    assert "new photos: 4 points, mean error of 1 point 0.1000 -0.0500 0.0200 units, root mean square 0.1000" in text


def geographic(run):
    ORIGIN.write(run.results / "model")
    return dict(zip(POINTS, ORIGIN.to_geodetic(np.array(list(POINTS.values())))))


AXES = ("east_m", "north_m", "up_m")


def test_latitude_and_longitude(run, capsys):
    places = {**geographic(run), "no fix": (0, 0, 0)}
    tables = run.tables(places, "point,latitude,longitude,height")
    assert main(["control_points", str(run.results), *map(str, tables), "--crs", "EPSG:32632"]) == 1
    assert "--crs has no effect" in capsys.readouterr().err
    assert_shift_found(*run.compare(capsys, *tables), AXES)
    assert "points that are not on the Earth, or 0, 0: no fix" in run.lines


def grid(run, crs="EPSG:32632"):
    places = geographic(run)
    return dict(zip(places, from_geodetic(find_crs(crs), np.array(list(places.values()))).tolist()))


def test_list_of_open_drone_map(run, capsys):
    places = grid(run)
    lines = [
        " ".join(map(str, [*places[point], x - 0.5, y - 0.5, photo, point]))
        for (photo, point), (x, y) in run.marks_as_numbers()
    ]
    path = run.write("gcp_list.txt", "WGS84 UTM 32N", *lines)
    assert_shift_found(*run.compare(capsys, path), AXES)
    # Without names, points are numbered in their order.
    unnamed = run.write("unnamed.txt", "EPSG:32632", *(line.rpartition(" ")[0] for line in lines))
    rows, text = run.compare(capsys, unnamed)
    assert {point for point, _ in rows} == {"1", "2", "3", "4"} and "by 4 points: 0.1000 -0.0500 0.0200 m" in text


def test_markers_of_metashape(run, capsys):
    places = grid(run)
    photos = sorted({photo for photo, _ in run.marks})
    cameras = "".join(f'<camera id="{i}" label="{photo}"/>' for i, photo in enumerate(photos))
    markers = "".join(
        f'<marker id="{i}" label="{point}"><reference x="{x}" y="{y}" z="{z}" enabled="true"/></marker>'
        for i, (point, (x, y, z)) in enumerate(places.items())
    )
    seen = "".join(
        f'<marker marker_id="{i}">'
        + "".join(
            f'<location camera_id="{photos.index(photo)}" pinned="true" x="{x}" y="{y}"/>'
            for (photo, name), (x, y) in run.marks_as_numbers()
            if name == point
        )
        + '<location camera_id="0" pinned="false" x="1" y="2"/></marker>'
        for i, point in enumerate(places)
    )
    system = find_crs("EPSG:32632").to_wkt("WKT1_GDAL").replace('"', "&quot;")
    chunk = f"<cameras>{cameras}</cameras><markers>{markers}</markers><reference>{system}</reference>"
    frames = f"<frames><frame id='0'><markers>{seen}</markers></frame></frames>"
    path = run.write("markers.xml", f'<document version="1.2.0"><chunk>{chunk}{frames}</chunk></document>')
    assert_shift_found(*run.compare(capsys, path), AXES)


@pytest.mark.parametrize(
    ("columns", "crs", "name"),
    [
        ("X/Easting,Y/Northing,Z/Altitude", "EPSG:32632", "WGS 84 / UTM zone 32N (EPSG::32632)"),
        ("X/Longitude,Y/Latitude,Z/Altitude", "EPSG:4979", "WGS 84 (EPSG::4326)"),
    ],
)
def test_table_of_markers_of_metashape(columns, crs, name, run, capsys):
    _, marks = run.tables()
    rows = [f"{point},{','.join(map(repr, map(float, place)))}" for point, place in grid(run, crs).items()]
    path = run.write("markers.txt", f"#CoordinateSystem: {name}", f"#Label,{columns}", *rows, "# Total error,,,")
    assert_shift_found(*run.compare(capsys, path, marks), AXES)


def test_marks_of_pix4d_have_no_header(run, capsys):
    points, marks = run.tables(grid(run))
    marks.write_text("".join(marks.read_text().splitlines(keepends=True)[1:]))
    assert_shift_found(*run.compare(capsys, points, marks, "--crs", "EPSG:32632"), AXES)


def test_model_alone(run, capsys):
    run.results = run.results / "model"
    rows, text = run.compare(capsys, *run.tables())
    assert {photos for _, photos in rows} == {"database"} and "shift" not in text


def test_wrong_marks_are_named(run, capsys):
    run.marks["old1.jpg", "P3"] = run.marks["old1.jpg", "P3"] + [30, 40]
    rows, _ = run.compare(capsys, *run.tables())
    assert "the mark of 'P3' in old1.jpg is off by 50 px" in run.lines
    assert np.allclose([float(rows["P3", "database"][axis]) for axis in ("dx", "dy")], 0, atol=0.3)
    assert run.lines.count("is off by") == 1


def test_output(run, capsys):
    output = run.folder / "table.csv"
    assert main(["control_points", str(run.results), *map(str, run.tables()), "--output", str(output)]) == 0
    assert "point," not in capsys.readouterr().out and output.read_text().startswith("point,photos,marks,dx")


def test_report_gets_the_residuals(run, capsys):
    run.compare(capsys, *run.tables())
    entries = {(entry["point"], entry["photos"]): entry for entry in read_control_residuals(run.results)}
    assert np.allclose(entries["P1", "new"]["error"], SHIFT, atol=1e-3)
    assert np.allclose(entries["P1", "database"]["error"], 0, atol=1e-3)
    assert np.allclose(entries["P1", "new"]["surveyed"], POINTS["P1"])


def test_bad_items_are_left_out(run, capsys):
    points, marks = run.tables()
    marks.write_text(marks.read_text() + "old0.jpg,P1,x,3\nquery/lost.jpg,P1,3,4\nnobody.jpg,P9,3,4\n")
    points.write_text(points.read_text() + "P1,0,0,0\nP9,nan,0,0\n")
    marks.write_text(marks.read_text() + "old0.jpg,P9,700,20\nold1.jpg,P1,inf,20\nold1.jpg,P1,3,4\n")
    assert_shift_found(*run.compare(capsys, points, marks))
    assert "points.csv: left out: line 6 (point 'P1' is at another place before), line 7 (there is no x)" in run.lines
    assert "(point 'P1' is marked in 'old1.jpg' before)" in run.lines
    assert "the mark of 'P9' is outside of old0.jpg (640 x 480 pixels)" in run.lines
    assert "marks.csv: left out: line 22 (expected a number, found 'x')" in run.lines
    assert "2 photos with marks have no pose: nobody.jpg, query/lost.jpg" in run.lines


@pytest.mark.parametrize(
    ("lines", "words", "message"),
    [
        (
            ["point,x,y,z", "P1,1,2,3"],
            [],
            "there are no marks of points in photos: expected are a list of OpenDroneMap",
        ),
        (["photo,point,x,y", "nobody.jpg,P1,3,4"], [], "no mark is in a photo of"),
        (["photo,point,a,b", "old0.jpg,P1,3,4"], [], "has the columns photo, point, a, b; expected are"),
        (
            ["EPSG:32632", "1 2 3 4 5 old0.jpg"],
            [],
            "control points in geographic coordinates need a model with geo.json",
        ),
        (["EPSG:99999", "1 2 3 4 5 old0.jpg"], [], "EPSG:99999"),
        (["<document><chunk><marker"], [], "is not XML: it is damaged or cut off"),
        ([], [], "has no rows"),
        (["<document/>"], [], "is XML of an unknown kind"),
        (
            ["photo,point,x,y", "old0.jpg,P1,3,4"],
            ["--output", "no/folder"],
            "--output no/folder: ",
        ),
    ],
)
def test_bad_files(run, lines, words, message, capsys):
    path = run.write("file.txt", *lines)
    assert main(["control_points", str(run.results), str(path), *words]) == 1
    assert message in capsys.readouterr().err


def test_coordinates_of_another_system(run, capsys):
    tables = run.tables(grid(run))
    assert main(["control_points", str(run.results), *map(str, tables)]) == 1
    assert (
        "is more than 100 km away from the photos: name the system of its coordinates (--crs)"
        in capsys.readouterr().err
    )

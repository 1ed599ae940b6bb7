"""Positions of photos without rotations: the files that have them, and what is refused."""

import numpy as np
import PIL.Image
import pytest

import pose_files
from colmap_lazyloc.demo.survey import write_gps
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import Photos, Source
from colmap_lazyloc.pose_formats.positions import EXIF, POSITIONS, find_format, read_positions

PLACES = {"a/1.jpg": (47.3769, 8.5417, 430.0), "a/2.jpg": (47.3770, 8.5419, 431.0), "b/1.jpg": (47.3771, 8.5416, 432.5)}
ORIGIN = GeoOrigin(47.377, 8.5417, 431.0)


@pytest.fixture
def folder(tmp_path):
    return pose_files.write_named(tmp_path / "photos", list(PLACES))


def read(tmp_path, folder, text, **options):
    path = tmp_path / "positions.txt"
    path.write_text(text)
    assert find_format(path) == POSITIONS
    return read_positions(Source(path, Photos(folder), **options), POSITIONS)


def geodetic(positions):
    places = positions.origin.to_geodetic(np.array([photo.centre for photo in positions.photos]))
    return dict(zip((photo.name for photo in positions.photos), places))


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("name,latitude,longitude,altitude", "{name},{lat},{lon},{alt}"),
        ("# image lat lon height", "{name} {lat} {lon} {alt}"),
        ("Longitude;Latitude;File Name;Altitude", "{lon};{lat};photos/{name};{alt}"),
        ("EPSG:4326", "{name} {lon} {lat} {alt}"),
    ],
)
def test_positions_on_the_earth(header, line, folder, tmp_path):
    lines = [line.format(name=name, lat=lat, lon=lon, alt=alt) for name, (lat, lon, alt) in PLACES.items()]
    positions = read(tmp_path, folder, "\n".join([header, *lines]), origin=ORIGIN, crs="EPSG:32632")
    assert positions.origin == ORIGIN and [photo.accuracy_m for photo in positions.photos] == [None] * 3
    for name, place in geodetic(positions).items():
        assert place == pytest.approx(PLACES[name], abs=1e-7)


@pytest.mark.parametrize("unknown", ["-1", "0", "", "999999"])
def test_accuracies_and_rows_that_cannot_be_used(unknown, folder, tmp_path, caplog):
    rows = f"name,x,y,z,stddev_m\na/1.jpg,1,2,3,0.02\na/2.jpg,4,nan,6,0.02\nb/1.jpg,7,8,9,{unknown}\n"
    positions = read(tmp_path, folder, rows)
    assert [(photo.name, photo.centre, photo.accuracy_m) for photo in positions.photos] == [
        ("a/1.jpg", (1, 2, 3), 0.02),
        ("b/1.jpg", (7, 8, 9), None),
    ]
    assert positions.origin is None
    assert "1 of 3 poses is left out: line 3: there is no y" in caplog.text


def test_grid_coordinates(folder, tmp_path):
    positions = read(tmp_path, folder, "a/1.jpg 465396.0 5247075.0 430\n", crs="EPSG:32632")
    assert geodetic(positions)["a/1.jpg"][:2] == pytest.approx((47.376, 8.541), abs=2e-3)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("a/1.jpg 8.5 47.3 430\n", {"crs": "EPSG:4326"}, "need a first line `name latitude longitude altitude`"),
        ("a/1.jpg 8.5 47.3 430\n", {"origin": ORIGIN}, "--geo_origin: .*give --crs"),
        ("c/9.jpg 8.5 47.3 430\n", {}, "no photo that it names is in"),
        ("name,lat,lon,alt\na/1.jpg,0,0,0\n", {}, "no position is on the Earth"),
    ],
)
def test_positions_that_cannot_be_used(text, options, message, folder, tmp_path):
    with pytest.raises(InputError, match=message):
        read(tmp_path, folder, text, **options)


@pytest.mark.parametrize(
    "text",
    [
        "name,x,y,z,qw,qx,qy,qz\na.jpg,1,2,3,1,0,0,0\n",
        "name,x,y,z,yaw,pitch\na.jpg,1,2,3,4,5\n",
        "name,x,y,z,rx,ry,rz,rw\na.jpg,1,2,3,0,0,0,1\n",
        "EPSG:4326\na.jpg 8 47 400 1 2 3\n",
        "1 2 3 4\n",
    ],
)
def test_files_of_poses_are_not_positions(text, tmp_path):
    (tmp_path / "a.txt").write_text(text)
    assert find_format(tmp_path / "a.txt") is None


def test_gps_of_originals_belongs_to_photos_of_the_same_names(folder, tmp_path):
    """Photos that were made smaller have lost their EXIF."""
    originals = tmp_path / "originals"
    for name, centre in (("a/1.JPG", (1.0, 2.0, 3.0)), ("b/1.JPG", (-4.0, 5.0, 6.0))):
        (originals / name).parent.mkdir(parents=True)
        PIL.Image.new("RGB", (32, 24)).save(originals / name, "JPEG")
        write_gps(originals / name, np.array(centre))
    positions = read_positions(Source(originals, Photos(folder)), EXIF)
    assert [photo.name for photo in positions.photos] == ["a/1.jpg", "b/1.jpg"]
    first, second = (np.array(photo.centre) for photo in positions.photos)
    assert second - first == pytest.approx((-5, 3, 3), abs=0.02)

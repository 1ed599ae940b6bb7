"""Kinds of files and situations that used to go wrong: each gives right poses, or a line that names what is wrong."""

import json
import math

import numpy as np
import PIL.Image
import PIL.TiffImagePlugin
import pyproj
import pytest
from scipy.spatial.transform import Rotation

import pose_writers
from colmap_lazyloc import import_poses
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.pose_formats import geo
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.registry import find_format
from colmap_lazyloc.project import options as run_options
from pose_files import CAMERA, assert_poses, read, write_named
from pose_writers import WRITERS, make_poses, save, table, xyzw

ORIGIN = GeoOrigin(47.1, 11.8, 812.0)
UTM = "EPSG:32632"


# ---------------------------------------------------------------- frames


def to_geodetic(points, origin=ORIGIN):
    """Returns longitude, latitude and height of points in the local frame at an origin, not by the project's code."""
    steps = f"+proj=topocentric +ellps=WGS84 +lat_0={origin.latitude_deg} +lon_0={origin.longitude_deg}"
    steps = f"+proj=pipeline +step +inv {steps} +h_0={origin.height_m} +step +inv +proj=cart +ellps=WGS84"
    steps += " +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    return np.stack(pyproj.Transformer.from_pipeline(steps).transform(*np.asarray(points, float).T.tolist()), axis=1)


def to_grid(points, origin=ORIGIN, crs=UTM):
    transformer = pyproj.Transformer.from_crs("EPSG:4979", crs, always_xy=True)
    return np.stack(transformer.transform(*to_geodetic(points, origin).T.tolist()), axis=1)


def in_grid(poses, origin=ORIGIN, crs=UTM):
    """Returns poses in the axes of a grid: each is turned by the grid's axes at its place."""
    turned = {}
    for name, (rotation, centre) in poses.items():
        steps = to_grid([centre, *(centre + np.eye(3))], origin, crs)
        u, _, vt = np.linalg.svd((steps[1:] - steps[0]).T)
        turned[name] = u @ vt @ rotation, steps[0]
    return turned


GRID_WRITERS = {
    "csv": pose_writers.csv_quaternion,
    "angles": pose_writers.csv_angles,
    "translation": pose_writers.csv_translation,
    "pix4d": pose_writers.pix4d,
    "tum": pose_writers.tum,
    "transforms": pose_writers.transforms,
    "nvm": pose_writers.nvm,
    "colmap": pose_writers.colmap,
}


@pytest.mark.parametrize("kind", GRID_WRITERS)
def test_rotations_are_turned_with_positions(kind, tmp_path):
    """The grid is turned by 2 degrees against north here."""
    truth = make_poses([f"{index}.jpg" for index in range(4)])
    path = GRID_WRITERS[kind](tmp_path, in_grid(truth))
    folder = write_named(tmp_path / "photos", truth) if kind in ("tum", "nvm") else None
    posed = read(path, folder, crs=UTM, origin=ORIGIN)
    assert_poses(posed, truth, 1e-6, 1e-6)
    assert posed.origin == ORIGIN


def test_block_with_a_reference_system(tmp_path):
    truth = make_poses(["a.jpg", "b.jpg"])
    path = pose_writers.blocks_exchange(tmp_path, in_grid(truth), UTM, pose_writers.OPENGL, "XRightYUp")
    folder = write_named(tmp_path / "photos", truth)
    assert_poses(read(path, folder, origin=ORIGIN), truth, 1e-6, 1e-6)
    with pytest.raises(InputError, match="--crs EPSG:32633.*says itself"):
        read(path, folder, crs="EPSG:32633")


def test_angles_of_reality_capture_are_from_true_north(tmp_path):
    """Positions are in the grid, rotations in the frame east, north, up in the middle of the cameras."""
    truth = make_poses(["a.jpg", "b.jpg"])
    centres = to_grid([centre for _, centre in truth.values()])
    mixed = {name: (rotation, centre) for (name, (rotation, _)), centre in zip(truth.items(), centres, strict=True)}
    path = pose_writers.reality_capture(tmp_path, mixed)
    posed = read(path, write_named(tmp_path / "photos", truth), crs=UTM, origin=ORIGIN)
    assert_poses(posed, truth, 1e-6, 1e-5)


@pytest.mark.parametrize("beside", ["topocentric", "coords", "nothing"])
def test_projected_reconstruction_of_opendronemap(beside, tmp_path, caplog):
    """OpenDroneMap keeps reference_lla beside coordinates in UTM, minus whole metres."""
    reference = GeoOrigin(47.1, 11.8, 0.0)
    truth = make_poses([f"{index}.jpg" for index in range(4)])
    offset = np.array([*np.floor(to_grid([(0, 0, 0)], reference)[0, :2]), 0]) + (2, -3, 0)
    projected = {name: (r, c - offset) for name, (r, c) in in_grid(truth, reference).items()}
    lla = (47.1, 11.8, 0.0)
    path = pose_writers.opensfm(tmp_path, projected, lla, "opensfm/reconstruction.json")
    if beside == "topocentric":
        pose_writers.opensfm(tmp_path, truth, lla, "opensfm/reconstruction.topocentric.json")
    if beside == "coords":
        save(tmp_path, "odm_georeferencing/coords.txt", f"WGS84 UTM 32N\n{offset[0]:.0f} {offset[1]:.0f}\n")
    posed = read(path)
    if beside == "nothing":
        assert posed.origin is None and "without a place on the Earth" in caplog.text
        assert_poses(posed, projected)
    else:
        assert posed.origin == reference
        assert_poses(posed, truth, 1e-4, 1e-5)  # the transform of OpenDroneMap is linear


@pytest.mark.parametrize(("latitude", "hemisphere"), [(47.1, "6"), (-33.5, "7")])
def test_shots_of_opendronemap_are_in_the_zone_of_their_coordinates(latitude, hemisphere, tmp_path):
    origin = GeoOrigin(latitude, 11.8, 300.0)
    truth = make_poses(["a.jpg", "b.jpg"])
    coordinates = dict(zip(truth, to_geodetic([c for _, c in truth.values()], origin).tolist(), strict=True))
    path = pose_writers.odm_shots(tmp_path, in_grid(truth, origin, f"EPSG:32{hemisphere}32"), coordinates)
    assert_poses(read(path, origin=origin), truth, 1e-6, 1e-6)


def test_grid_in_feet_needs_a_system_of_the_heights(tmp_path):
    path = pose_writers.csv_quaternion(tmp_path, make_poses(["a.jpg"], shift=(3_000_000, 1_700_000, 5000)))
    for crs, metres in (("EPSG:2232+6360", 5000 * 1200 / 3937), ("EPSG:2232+5703", 5000)):
        height = read(path, crs=crs).origin.height_m
        assert abs(height - metres) < 100  # between the sea and the ellipsoid
    with pytest.raises(InputError, match="EPSG:2232: is in the unit US survey foot, which leaves that of heights open"):
        read(path, crs="EPSG:2232")


def test_missing_grid_of_the_geoid_is_a_line(caplog):
    """Without it, PROJ leaves heights above the sea as they are."""
    geo.find_crs.cache_clear()
    crs = geo.find_crs("EPSG:25832+5773")
    ((_, _, height),) = geo.to_geodetic(crs, np.array([[500_000.0, 5_400_000.0, 400.0]]))
    assert ("no grid of the geoid (us_nga_egm96_15.tif" in caplog.text) == (height == 400.0)
    caplog.clear()
    geo.find_crs("EPSG:25832")
    assert not caplog.text


@pytest.mark.parametrize(
    ("crs", "place", "is_outside"),
    [
        ("EPSG:25832", (43.1, -89.4), True),  # Wisconsin
        ("EPSG:25832", (50.8, 5.9), False),  # Aachen, west of 6 degrees
        ("EPSG:25832", (20.0, 9.0), True),
        ("EPSG:25832+5773", (43.1, -89.4), True),
        ("EPSG:32601", (60.0, 179.9), False),  # zone 1 begins at 180 degrees
        ("EPSG:32601", (60.0, -179.0), False),
        ("EPSG:3832", (0.0, 179.9), False),  # from 98.69 to -68 degrees
        ("EPSG:3832", (0.0, 0.0), True),
        ("EPSG:3857", (60.0, -180.0), False),
        ("EPSG:3857", (60.0, 359.0), False),
        ("+proj=utm +zone=32 +datum=WGS84", (43.1, -89.4), False),  # has no area of use
    ],
)
def test_positions_outside_of_the_area_of_use(crs, place, is_outside, caplog):
    geo.find_crs(crs)
    caplog.clear()
    geo.warn_outside(crs, np.array([[*place, 300.0]]))
    assert [f"--crs {crs}: 1 of 1 positions are outside" in text for text in caplog.messages] == [True] * is_outside


@pytest.mark.parametrize("write", [pose_writers.csv_angles, pose_writers.pix4d])
def test_angles_in_geocentric_axes_are_refused(write, tmp_path):
    path = write(tmp_path, make_poses(["a.jpg"], shift=(4_000_000, 900_000, 4_800_000)))
    with pytest.raises(InputError, match="--crs EPSG:4978: (yaw|omega), .* are no angles about the axes"):
        read(path, crs="EPSG:4978")


@pytest.mark.parametrize(
    ("scale", "middle", "warns"),
    [
        ((1e-5, 1e-5, 1), (8.5, 47.3, 410), True),
        ((1e-5, 1e-5, 1), (-70.1, -33.4, 600), True),
        ((1, 1, 1), (8.5, 47.3, 410), False),
        ((1, 1, 1), (0, 0, 0), False),
        ((1e-5, 1e-5, 1e-5), (8.5, 47.3, 410), False),
        ((1e-5, 1e-5, 1), (0, 0, 0), False),
    ],
)
def test_degrees_without_a_reference_system_are_named(scale, middle, warns, tmp_path, caplog):
    truth = {
        name: (turn, centre * scale + middle)
        for name, (turn, centre) in make_poses(["a.jpg", "b.jpg", "c.jpg"]).items()
    }
    path = pose_writers.csv_quaternion(tmp_path, truth)
    read(path)
    assert ("look like degrees of longitude and latitude: give --crs EPSG:4326" in caplog.text) == warns
    caplog.clear()
    if warns:
        assert read(path, crs="EPSG:4326").origin is not None and not caplog.messages


def test_origin_moves_every_local_frame(tmp_path):
    """Two surveys get one frame."""
    truth = make_poses(["a.jpg", "b.jpg"])
    path = pose_writers.opensfm(tmp_path, truth, (47.101, 11.801, 400.0))
    posed = read(path, origin=ORIGIN)
    place = to_geodetic([c for _, c in truth.values()], GeoOrigin(47.101, 11.801, 400.0))
    found = to_geodetic([image.cam_from_world.cam_in_world for image in posed.images])
    assert posed.origin == ORIGIN and np.allclose(place, found, atol=1e-9)
    model = pose_writers.colmap(tmp_path, truth)
    with pytest.raises(InputError, match="--geo_origin.*give --crs"):
        read(model, origin=ORIGIN)
    ORIGIN.write(model)
    assert read(model).origin == ORIGIN
    assert read(model, origin=GeoOrigin(47.2, 11.8, 0.0)).origin == GeoOrigin(47.2, 11.8, 0.0)


def test_model_keeps_every_bit(tmp_path):
    """Reads a quaternion with rounding errors and a point far away; one of length 2 is read as by COLMAP."""
    path = pose_writers.colmap(tmp_path, make_poses(["a.jpg"]))
    line = "0.9999 0.001 0.003 1e-17 5200000.123456789 1 2 1 a.jpg"
    save(tmp_path, "model/images.txt", f"1 {line}\n\n2 2 0 0 0 0 0 0 1 b.jpg\n\n")
    first, second = read(path, camera=None).images
    assert first.cam_from_world.qvec.tolist() == [0.9999, 0.001, 0.003, 1e-17]
    assert first.cam_from_world.tvec.tolist() == [5200000.123456789, 1, 2]
    assert second.cam_from_world.qvec.tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("sfm_data.json", '{"sfm_data_version": "0.3", "views": []}', "openMVG: convert it by openMVG_main_openMVG2"),
        ("cameras.sfm", '{"version": ["1"], "views": [], "intrinsics": [], "poses": []}', "Meshroom: export"),
        ("17.json", '{"t_00": 1, "fx": 500, "timestamp": 1}', "keyframe of Polycam: give the folder"),
        ("a.xmp", "<x:xmpmeta xmlns:x='adobe:ns:meta/'/>", "an XMP file without a pose"),
        ("geo.txt", "EPSG:4326\na.jpg 8.5 47.3\n", "has positions without rotations"),
        ("geo.txt", "EPSG:4326\na.jpg 8.5 47.3 408.0\n", "has positions without rotations"),
        ("a.txt", "+proj=utm +zone=32\na.jpg 8.5 47.3 408.0\n", "has positions without rotations"),
        ("a.csv", "name,lat,lon,alt\na.jpg,47.3,8.5,408\n", "has positions without rotations.*lazyloc run --poses"),
        ("a.txt", "a.jpg 1 2 3\n", "has positions without rotations"),
        (
            "r.csv",
            "#CoordinateSystem: WGS 84\n#Label,X/Longitude,Y/Latitude\na.jpg,8,47\n",
            "reference table of Metashape",
        ),
        (
            "r.csv",
            "Label,X/East,Y/North,Z/Altitude,Yaw,Pitch,Roll\na.jpg,1,2,3,4,5,6\n",
            "reference table of Metashape",
        ),
        ("database.db", b"SQLite format 3\0...", "database of COLMAP"),
        ("points.ply", "ply\nformat ascii 1.0\n", "point cloud or mesh"),
        ("cloud.las", b"LASF\0\0", "point cloud"),
        ("scan.usdz", b"PK\x03\x04", "USDZ or zip"),
        ("poses_bounds.npy", b"\x93NUMPY\x01", "array of numpy"),
        ("poses.pkl", b"\x80\x04\x95", "pickle"),
        ("graph.g2o", "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "g2o"),
        ("images.txt", "1 1 0 0 0 0 0 0 1 a.jpg\n\n", "give the folder of the model"),
        ("IMG_1.JPG", b"\xff\xd8\xff\xe0", "a photo"),
        ("table.csv", "name,x".encode("utf-16"), "UTF-16"),
        ("other.json", '{"a": 1, "b": 2}', "JSON of an unknown kind"),
        ("track.gpx", "<gpx><trk/></gpx>", "track of a receiver or of a drone"),
        ("data.bin", b"\1\2\0\3", "binary file"),
        ("data.csv", "#timestamp,p_RS_R_x [m],q_RS_w []\n1,2,1\n", "give --calibration"),
        ("a_calibrated_camera_parameters.txt", "fileName imageWidth imageHeight\n", "file of Pix4D with matrices"),
        ("a.json", '{"class_name": "PinholeCameraTrajectory", "parameters": []}', "Open3D in JSON"),
        ("DJI_0001.SRT", "1\n00:00:00,000 --> 00:00:00,033\n[latitude: 47.1]\n", "track of a receiver or of a drone"),
        ("notes.txt", "hello\n", "its format is not known"),
    ],
)
def test_files_of_other_programs_are_named(name, content, message, tmp_path):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message) as error:
        read(path)
    assert str(path) in str(error.value)


def test_folder_above_a_model_is_named(tmp_path):
    model = pose_writers.colmap(tmp_path, make_poses(["a.jpg"]))
    with pytest.raises(InputError, match=f"holds no COLMAP model.*; give {model}"):
        read(tmp_path)


# ---------------------------------------------------------------- columns


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("photo_id,a,b,c,d,e,f,g", "has the columns photo_id, a, b, c, d, e, f, g; expected are name"),
        ("name,x,y,height,qw,qx,qy,qz", "expected are name"),
        ("name,tx,ty,tz,yaw,pitch,roll,a", "expected are name"),
        ("name,x,y,z,rx,ry,rz,rw", "expected are name"),
        ("1,2,3,4,5,6,7,a.jpg", "expected are name"),
        ("name,x,y,z,qw,qx,qy,X", "has two columns 'x'"),
    ],
)
def test_columns_that_are_not_understood_are_named(header, message, tmp_path):
    path = save(tmp_path, "a.csv", f"{header}\na.jpg,1,2,3,1,0,0,0\n")
    with pytest.raises(InputError, match=message):
        read(path)


def test_columns_that_are_not_used_are_named(tmp_path, caplog):
    path = table(tmp_path, "a.csv", "name,x,y,z,qw,qx,qy,qz,score,iso", [("a.jpg", [1, 2, 3, 1, 0, 0, 0, 9, 100])])
    assert len(read(path).images) == 1 and "columns that are not used: score, iso" in caplog.text


UNUSED = {
    "transforms": (pose_writers.transforms, '"frames": [', '"pose_type": "w2c", "frames": [', "pose_type"),
    "a frame of transforms": (pose_writers.transforms, '{"file_path"', '{"crop": [0, 0, 9, 9], "file_path"', "crop"),
    "record3d": (pose_writers.record3d, '"fps"', '"crop": [0, 0, 9, 9], "fps"', "crop"),
    "splatting": (pose_writers.splatting, '"id"', '"pose_type": "w2c", "id"', "pose_type"),
    "a shot of opensfm": (
        pose_writers.opensfm,
        '"rotation"',
        '"orientation": 6, "pose_type": 1, "rotation"',
        "pose_type",
    ),
    "a camera of opensfm": (pose_writers.opensfm, '"width"', '"aspect_ratio": 1.1, "width"', "aspect_ratio"),
    "shots.geojson": (pose_writers.odm_shots, '"rotation"', '"pose_type": 1, "rotation"', "pose_type"),
    "metashape": (pose_writers.metashape, "<f>", "<crop>1</crop><f>", "crop"),
    "blocks": (pose_writers.blocks_exchange, "<Photo>", "<Photo><Crop>1</Crop>", "Crop"),
}


@pytest.mark.parametrize("kind", UNUSED)
def test_keys_that_are_not_used_are_named(kind, tmp_path, caplog):
    """One line, also for many photos; what has nothing to do with poses, and what is not set, is not named."""
    write, before, after, named = UNUSED[kind]
    path = write(tmp_path, truth := make_poses(["a.jpg", "b.jpg"]))
    folder = write_named(tmp_path / "photos", truth if kind != "record3d" else ["0.jpg", "1.jpg"])
    read(path, folder)
    assert "not used" not in caplog.text
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))
    assert len(read(path, folder, camera=None).images) == 2
    lines = [record.message for record in caplog.records if "not used" in record.message]
    assert len(lines) == 1 and lines[0].endswith(f"keys that are not used: {named}")


def test_an_angle_of_view_that_contradicts_the_focal_length_is_named(tmp_path, caplog):
    path = pose_writers.transforms(tmp_path, truth := make_poses(["a.jpg", "b.jpg"]))
    text = path.read_text()
    right = 2 * math.atan(pose_writers.WIDTH / 2 / pose_writers.FX)
    for angle, message in ((f"{right:.3f}", None), (1.1 * right, "not used: camera_angle_x, which contradicts the")):
        path.write_text(text.replace('"fl_x"', f'"camera_angle_x": {angle}, "fl_x"'))
        posed = read(path, camera=None)
        assert_poses(posed, truth)
        assert posed.images[0].camera.params[0] == pose_writers.FX
        assert (message or "") in caplog.text and (message is not None) == ("not used" in caplog.text)


@pytest.mark.parametrize(
    ("head", "own", "message"),
    [
        ("NVM_V3", "500 {} 0.1 0", "has no FixedK: principal points are taken to be in the middle of the photos"),
        ("NVM_V3 FixedK 500 320 500 240 0.1", "500 {} 0 0", None),
        ("NVM_V3 FixedK 500 320 500 240 0.1", "500.1 {} 0.1 0", None),
        ("NVM_V3 FixedK 500 320 500 240 0", "500 {} 0.1 0", "of 1 of 1 cameras are not used, because they contradict"),
        ("NVM_V3 FixedK 500 320 500 240 0", "600 {} 0 0", "of 1 of 1 cameras are not used, because they contradict"),
    ],
)
def test_intrinsics_beside_those_of_visual_sfm(head, own, message, tmp_path, caplog):
    caplog.set_level("INFO")
    path = save(tmp_path, "model.nvm", f"{head}\n\n1\na.jpg\t{own.format('1 0 0 0 1 2 3')}\n\n0\n")
    read(path, write_named(tmp_path / "photos", ["a.jpg"]), camera=None)
    assert (message or "") in caplog.text
    assert message is not None or "not used" not in caplog.text
    caplog.clear()
    read(path, camera=CAMERA)
    assert not caplog.text


def test_another_head_of_visual_sfm_is_refused(tmp_path):
    with pytest.raises(InputError, match="begins with 'NVM_V3 fixed 500' instead of NVM_V3"):
        read(save(tmp_path, "model.nvm", "NVM_V3 fixed 500\n\n0\n"))


def test_trailing_separators(tmp_path):
    path = save(tmp_path, "a.csv", "name,x,y,z,yaw,pitch,roll,\na.jpg,1,2,3,0,0,0,\n")
    assert np.allclose(read(path).images[0].cam_from_world.cam_in_world, (1, 2, 3))


def test_decimal_commas(tmp_path):
    path = save(tmp_path, "a.csv", "name;x;y;z;yaw;pitch;roll\na.jpg;1,5;-2,25;3;0;0;0\n")
    assert np.allclose(read(path).images[0].cam_from_world.cam_in_world, (1.5, -2.25, 3))


@pytest.mark.parametrize(
    ("separator", "form"), [(";", "{:.12f}"), (";", "{:.12E}"), ("\t", "{:.12f}"), ("\t", "{:.12e}"), (" ", "{:.12f}")]
)
@pytest.mark.parametrize("first", ["", "sep=SEPARATOR\n"])
def test_decimal_commas_beside_other_separators(separator, form, first, tmp_path):
    truth = make_poses(["a.jpg", "b.jpg"])
    lines = [["name", "x", "y", "z", "qw", "qx", "qy", "qz"]]
    for name, (rotation, centre) in truth.items():
        lines.append(
            [name, *(form.format(value).replace(".", ",") for value in (*centre, *pose_writers.wxyz(rotation)))]
        )
    text = "".join(separator.join(words) + "\n" for words in lines)
    path = save(tmp_path, "a.csv", first.replace("SEPARATOR", separator) + text)
    assert_poses(read(path), truth)


UNITS = [
    ("name,x [mm],Y (mm),z [millimetres],qw,qx,qy,qz", 1000, 1, None),
    ("name,X (cm),Y (cm),Z (cm),qw [],qx [],qy [],qz []", 100, 1, None),
    ("name,x [m],y (metres),z [km],qw,qx,qy,qz", (1, 1, 1e-3), 1, None),
    ("name,X (East),Y (North),Z (Up),qw,qx,qy,qz", 1, 1, None),
    ("name,x,y,z,yaw [rad],pitch (rad),roll [radians]", 1, np.pi / 180, "ypr"),
    ("name,x,y,z,yaw [gon],pitch [gon],roll [gon]", 1, 1 / 0.9, "ypr"),
    ("name,x,y,z,Yaw (°),Pitch (deg),Roll [degrees]", 1, 1, "ypr"),
    ("name,x,y,z,omega [rad],phi [rad],kappa [rad]", 1, np.pi / 180, "opk"),
]


@pytest.mark.parametrize(("header", "of_metre", "of_degree", "kind"), UNITS)
def test_units_in_brackets_are_used(header, of_metre, of_degree, kind, tmp_path):
    truth, rows = make_poses(["a.jpg", "b.jpg"]), []
    for name, (rotation, centre) in truth.items():
        if kind == "ypr":
            level = rotation @ pose_writers.LEVEL.T
            turn = Rotation.from_matrix(level).as_euler("ZXY", degrees=True) * (-of_degree, of_degree, of_degree)
        elif kind == "opk":
            turn = Rotation.from_matrix(rotation @ pose_writers.OPENGL).as_euler("XYZ", degrees=True) * of_degree
        else:
            turn = np.array(pose_writers.wxyz(rotation))
        rows.append((name, centre * of_metre, turn))
    assert_poses(read(table(tmp_path, "a.csv", header, rows)), truth)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("name,latitude,longitude,altitude (ft),yaw,pitch,roll", "a column is in ft: give metres and degrees"),
        ("name,x [feet],y [feet],z [feet],yaw,pitch,roll", "a column is in feet"),
        ("name,x [in],y,z,yaw,pitch,roll", "a column is in in:"),
        ("name,x,y,z,yaw,pitch,roll,fx [mm]", "the intrinsics are in mm, not in pixels"),
    ],
)
def test_units_that_are_not_used_are_refused(header, message, tmp_path):
    path = table(tmp_path, "a.csv", header, [("a.jpg", [1, 2, 3, 4, 5, 6, 500][: header.count(",")])])
    with pytest.raises(InputError, match=message):
        read(path, write_named(tmp_path / "photos", ["a.jpg"]), camera=None if "fx" in header else CAMERA)


def reality_capture_list(folder, poses, header, first=""):
    """Writes "Comma separated Name, X, Y, Z, Heading, Pitch, Roll", of which there are several headers."""
    rows = []
    for name, (rotation, centre) in poses.items():
        angles = Rotation.from_matrix(rotation @ pose_writers.OPENGL).as_euler("ZXY", degrees=True)
        rows.append((name, centre, angles * (-1, 1, 1)))
    return table(folder, "rc.csv", first + header, rows)


@pytest.mark.parametrize("first", ["", "#cameras 2\n", "#cameras 2\r\n"])
@pytest.mark.parametrize("height", ["alt", "z"])
@pytest.mark.parametrize("heading", ["heading", "yaw"])
def test_lists_of_reality_capture_without_intrinsics(first, height, heading, tmp_path):
    """A camera at heading, pitch and roll 0 looks down, not along the horizon as in a table of one's own."""
    truth = make_poses(["a.jpg", "b.jpg"])
    path = reality_capture_list(tmp_path, truth, f"#name,x,y,{height},{heading},pitch,roll", first)
    assert_poses(read(path), truth)
    with pytest.raises(InputError, match="by its #name.*: give the format realitycapture, or remove the #"):
        read(path, form="csv")


def test_omega_phi_kappa_of_reality_capture_are_refused(tmp_path):
    path = table(tmp_path, "rc.csv", "#name,x,y,z,omega,phi,kappa", [("a.jpg", [1, 2, 3, 4, 5, 6])])
    with pytest.raises(
        InputError, match="omega, phi, kappa, which have another order there: export 'Internal/External"
    ):
        read(path)


def test_omega_phi_kappa_of_metashape(tmp_path, caplog):
    """The file has commas in its comment and tabs between its columns, and a matrix beside the angles."""
    truth, rows = make_poses(["IMG 1.jpg", "IMG 2.jpg"]), []
    for name, (rotation, centre) in truth.items():
        turn = rotation @ pose_writers.OPENGL
        angles = Rotation.from_matrix(turn).as_euler("XYZ", degrees=True)
        rows.append((name[:-4], centre, angles, turn.T.ravel()))
    names = ", ".join(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
    header = f"# Cameras (2)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa, {names}"
    path = table(tmp_path, "opk.txt", header, rows, "\t")
    assert_poses(read(path, write_named(tmp_path / "photos", list(truth))), truth)
    assert "not used" not in caplog.text


def test_names_with_blanks_between_blanks(tmp_path):
    truth = make_poses(["my set/IMG 1.JPG", "my set/IMG 2.JPG"])
    assert_poses(read(pose_writers.pix4d(tmp_path, truth)), truth)
    bundler = pose_writers.bundler(tmp_path, truth)
    photos = write_named(tmp_path / "photos", list(truth))
    assert_poses(read(bundler, photos), truth)
    save(tmp_path, "list.txt", "".join(f"{name}\n" for name in truth))
    assert_poses(read(bundler, photos), truth)


def test_bundle_with_lines_of_other_cameras_is_refused(tmp_path):
    path = pose_writers.bundler(tmp_path, truth := make_poses(["a.jpg", "b.jpg", "c.jpg"]))
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:10], *lines[5:]]) + "\n")
    with pytest.raises(InputError, match="bundle.out: has 21 lines instead of 16: it is damaged"):
        read(path)
    path.write_text("\n".join([*lines[:8], *lines[12:]]) + "\n")
    with pytest.raises(InputError, match="bundle.out: has 12 lines instead of 16: it is damaged"):
        read(path)
    points = ["1 2 3", "255 255 255", "1 0 0 0.5 0.5"] * 2
    path.write_text("\n".join(["# Bundle file v0.3", "3 2", *lines[2:], *points]) + "\n")
    assert_poses(read(path), truth)


def test_list_without_names_of_columns_and_commas_is_ambiguous(tmp_path):
    """EuRoC's order of quaternions begins with w, TUM's ends with it."""
    truth = make_poses([f"{time:.6f}.jpg" for time in (1, 1.1)])
    rows = [(name[:-4], centre, xyzw(rotation)) for name, (rotation, centre) in truth.items()]
    path = save(tmp_path, "a.csv", "".join(pose_writers.row(*values, separator=",") for values in rows))
    photos = write_named(tmp_path / "photos", list(truth))
    with pytest.raises(InputError, match="their quaternions begin or end with w: give --quaternion_order"):
        read(path, photos)
    assert_poses(read(path, photos, quaternion_order="xyzw"), truth)
    path.write_text("timestamp,tx,ty,tz,qx,qy,qz,qw\n" + path.read_text())
    assert_poses(read(path, photos), truth)


def test_poses_of_this_program_and_a_trajectory_are_told_apart(tmp_path):
    truth = make_poses(["my photo.jpg", "b.jpg"])
    path = pose_writers.poses_txt(tmp_path, truth)
    assert_poses(read(path), truth)
    path.write_text("# name qw qx qy qz tx ty tz\n" + path.read_text().replace("my photo", "1"))
    assert find_format(path) == "poses"
    with pytest.raises(InputError, match="column with names"):
        read(path, form="tum")


@pytest.mark.parametrize("form", [None, "poses", "csv"])
@pytest.mark.parametrize("comment", ["# ", "#", "", "# made by a walk\n# "])
@pytest.mark.parametrize(
    ("columns", "format_name"),
    [
        ("name qw qx qy qz tx ty tz", "poses"),
        ("name qx qy qz qw tx ty tz", "csv"),
        ("name tx ty tz qw qx qy qz", "csv"),
        ("name tx ty tz qx qy qz qw", "csv"),
        ("name qw qx qy qz x y z", "csv"),
        ("image_name x y z qx qy qz qw", "csv"),
        ("qw qx qy qz tx ty tz name", "csv"),
        ("name, qx, qy, qz, qw, tx, ty, tz", "csv"),
    ],
)
def test_columns_separated_by_blanks_go_by_their_header(columns, format_name, comment, form, tmp_path):
    if "," in columns and not comment:
        pytest.skip("a row with names is separated as the others are")
    truth = make_poses(["1.jpg", "2.jpg"])
    lines = []
    for name, (rotation, centre) in truth.items():
        # Beside the centre, quaternions are world_from_cam.
        x, y, z, w = xyzw(rotation.T if "tx" in columns else rotation)
        numbers = (w, x, y, z, *(-rotation.T @ centre), *centre)
        values = dict(zip(("qw", "qx", "qy", "qz", "tx", "ty", "tz", "x", "y", "z"), numbers, strict=True))
        words = {"name": name, "image_name": name} | {key: repr(float(value)) for key, value in values.items()}
        lines.append(" ".join(words[column] for column in columns.replace(",", "").split()) + "\n")
    path = save(tmp_path, "walk.txt", f"{comment}{columns}\n{''.join(lines)}")
    assert find_format(path) == format_name
    assert_poses(read(path, form=form), truth)


@pytest.mark.parametrize("columns", ["name a b c d e f g", "name rw rx ry rz px py pz", "name qw qx qy qz tx ty tw"])
@pytest.mark.parametrize("comment", ["# ", ""])
@pytest.mark.parametrize("form", [None, "poses"])
def test_header_separated_by_blanks_that_is_not_understood(columns, comment, form, tmp_path):
    path = save(tmp_path, "walk.txt", f"{comment}{columns}\na.jpg 1 0 0 0 1 2 3\n")
    with pytest.raises(InputError, match=f"has the columns {columns.replace(' ', ', ')}; expected are name"):
        read(path, form=form)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cx": 0.5}, "the principal point's cx is 0.5 pixels for an image of 640 x 480 pixels"),
        ({"cy": -3}, "the principal point's cy is -3 pixels"),
        ({"cx": 5000}, "the principal point's cx is 5000 pixels"),
        ({"fl_x": 1e30}, r"the focal length is 1e\+30 pixels"),
        ({"fl_y": 1.2}, "the focal length is 1.2 pixels"),
        ({"fl_x": None, "fl_y": None, "camera_angle_x": 65.2}, "camera_angle_x is 65.2, .* is it in degrees?"),
        ({"fl_x": None, "fl_y": None, "camera_angle_x": 0}, "camera_angle_x is 0, "),
    ],
)
def test_intrinsics_that_cannot_be_are_refused(values, message, tmp_path):
    path = pose_writers.transforms(tmp_path, make_poses(["a.jpg"]))
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))
    with pytest.raises(InputError, match=message):
        read(path, camera=None)


@pytest.mark.parametrize(
    "camera",
    [
        Camera("SIMPLE_RADIAL", 640, 480, (40, 20, 460, 0.1)),
        Camera("FISHEYE", 640, 480, (200, 200, 320, 240)),
        Camera("EUCM", 640, 480, (200, 200, 320, 240, 0.5, 1)),
        Camera("EQUIRECTANGULAR", 640, 320, (640, 320)),
        Camera("DIVISION", 640, 480, (30000, 30000, 320, 240, 0)),
    ],
)
def test_unusual_intrinsics_are_taken(camera, tmp_path):
    path = pose_writers.poses_txt(tmp_path, make_poses(["a.jpg"]))
    assert read(path, camera=camera).images[0].camera == camera


@pytest.mark.parametrize("origin", ["-33.0,151,0", "-.5,-151,-3"])
def test_origin_in_the_south(origin, tmp_path):
    latitude, longitude, height = map(float, origin.split(","))
    path = table(
        tmp_path, "a.csv", "name,lat,lon,alt,yaw,pitch,roll", [("a.jpg", [latitude, longitude, height, 0, 0, 0])]
    )
    words = ["csv", str(path), "--output_path", str(tmp_path / "model"), "--camera", CAMERA.text()]
    assert import_poses.main([*words, "--geo_origin", origin]) == 0
    assert GeoOrigin.read(tmp_path / "model") == GeoOrigin(latitude, longitude, height)
    words = ["--database_images", "a", "--queries", "b", "--output", "c", "--geo_origin", origin]
    assert run_options.parse_arguments(None, words)[0].geo_origin == origin


@pytest.mark.parametrize(
    ("form", "text", "message"),
    [
        ("transforms", '{"frames": null}', "there is null instead of a list of poses"),
        ("transforms", '{"frames": {"a": 1}}', "there is an object instead of a list of poses"),
        ("transforms", '{"frames": ["a", "b"]}', "all 2: there is a text where another value is expected"),
        ("transforms", '{"frames": []}', "no photo that it names"),
        ("transforms", '{"frames": [{"file_path": "a", "transform_matrix": [["x"]]}]}', "expected a number, found 'x'"),
        ("transforms", '{"frames": [{"file_path": "a", "transform_matrix": [[1], 2]}]}', "not those of a matrix"),
        ("transforms", "[]", "there is a list where another value is expected"),
        ("opensfm", "[]", "has no reconstruction"),
        ("opensfm", '[{"shots": []}]', "there is a list where another value is expected"),
        ("record3d", '{"poses": [[1]], "perFrameIntrinsicCoeffs": [], "w": 1, "h": 1, "K": 1}', "a number where"),
        ("nvm", "NVM_V3\n", "it has too few"),
        *((form, "", "a.txt: is empty$") for form in (None, "transforms", "csv", "tum", "metashape", "poses")),
        ("poses", " \n\n", "a.txt: is empty$"),
        ("poses", "a.jpg 0 0 0 0 1 2 3\nb.jpg 0 0 0 0 1 2 3\n", "no pose can be used: all 2: "),
    ],
)
def test_what_is_wrong_is_said_in_the_words_of_the_file(form, text, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read(save(tmp_path, "a.txt", text), form=form)


@pytest.mark.parametrize("num_places", [0, 1, 2])
@pytest.mark.parametrize("chunk", ["", "<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><scale>1</scale></transform>"])
def test_components_of_metashape_without_a_transform_are_left_out(num_places, chunk, tmp_path, caplog):
    truth = make_poses(["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"])
    path = pose_writers.metashape(tmp_path, truth)
    place = "<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>0 0 0</translation></transform>"
    parts = "".join(f'<component id="{i}">{place if i >= 2 - num_places else ""}</component>' for i in range(2))
    text = path.read_text().replace("<cameras>", f"{chunk}<components>{parts}</components><cameras>")
    for index in range(5):
        text = text.replace(f'<camera id="{index}"', f'<camera id="{index}" component_id="{int(index > 2)}"')
    path.write_text(text)
    names = list(truth)
    kept = {0: names[:3], 1: names[3:], 2: names}[num_places]
    assert_poses(read(path), {name[:-4]: truth[name] for name in kept})
    assert (f"{5 - len(kept)} photos of 1 other components are left out" in caplog.text) == (num_places < 2)


# ---------------------------------------------------------------- what is given is used or refused


@pytest.mark.parametrize("kind", ["fisheye", "equidistant_fisheye"])
def test_tangential_coefficients_of_a_fisheye(kind, tmp_path):
    path = pose_writers.metashape(tmp_path, make_poses(["a.jpg"]), kind, "<k1>0.01</k1><p1>0.002</p1><p2>-0.001</p2>")
    camera = read(path, camera=None).images[0].camera
    assert camera.model == "THIN_PRISM_FISHEYE"
    assert camera.params == (500, 510, 310, 250, 0.01, 0, -0.001, 0.002, 0, 0, 0, 0)


def test_tangential_coefficients_of_reality_capture(tmp_path):
    path = pose_writers.reality_capture(tmp_path, make_poses(["a.jpg"]))
    path.write_text(path.read_text().replace(",0.0,0.0,0.0,0.0,0.0,0.0\n", ",-0.05,0.02,0.0,0.0,0.001,-0.002\n"))
    camera = read(path, write_named(tmp_path / "photos", ["a.jpg"]), camera=None).images[0].camera
    assert camera.params == (500, 500, 310, 250, -0.05, 0.02, -0.002, 0.001)


@pytest.mark.parametrize(
    ("kind", "names"),
    [("transforms", '"cx":;"cxx":'), ("csv_quaternion", ",cx,;,c_left,"), ("opensfm", '"c_y":;"c_y_":'),
     ("reality_capture", ",py,;,p_y_px,"), ("xmp", "PrincipalPointU;Principal")],
)  # fmt: skip
def test_half_of_a_principal_point_is_refused(kind, names, tmp_path):
    """The other half would be the middle of the photo, without a word."""
    path = WRITERS[kind].write(tmp_path, make_poses(["a.jpg"]))
    file = path / "a.xmp" if path.is_dir() else path
    file.write_text(file.read_text().replace(*names.split(";"), 1))
    with pytest.raises(InputError, match=r"a camera has (c|p)_?[xy], but of .* both are needed"):
        read(path, write_named(tmp_path / "photos", ["a.jpg"]), camera=None)


def test_empty_coefficient_of_metashape_is_refused(tmp_path):
    path = pose_writers.metashape(tmp_path, make_poses(["a.jpg"]), more="<k1/>")
    with pytest.raises(InputError, match="expected a number, found ''"):
        read(path, camera=None)


@pytest.mark.parametrize(("key", "message"), [("k4", "k4"), ("k5", "k5"), ("s1", "s1"), ("skew", "skew"), ("p3", "p3")])
def test_coefficients_that_would_be_dropped_are_refused(key, message, tmp_path):
    transforms = pose_writers.transforms(tmp_path, make_poses(["a.jpg"]))
    transforms.write_text(json.dumps({**json.loads(transforms.read_text()), key: 0.1}))
    own = pose_writers.csv_quaternion(tmp_path, make_poses(["a.jpg"]))
    own.write_text(own.read_text().replace(",cy", f",cy,{key}").replace("250.0\n", "250.0,0.1\n"))
    metashape = pose_writers.metashape(tmp_path, make_poses(["a.jpg"]), more=f"<{key}>0.1</{key}>")
    for path in (transforms, own, metashape):
        with pytest.raises(InputError, match=message):
            read(path, camera=None)
        read(path)  # --camera replaces the intrinsics


@pytest.mark.parametrize("of_frames", [False, True])
def test_list_of_coefficients_of_nerfstudio(of_frames, tmp_path):
    path = pose_writers.transforms(tmp_path, make_poses(["a.jpg"]))
    data = json.loads(path.read_text())
    (data["frames"][0] if of_frames else data)["distortion_params"] = [0.1, 0.02, 0, 0, 0.001, 0.002]
    path.write_text(json.dumps(data))
    assert read(path, camera=None).images[0].camera.params[4:] == (0.1, 0.02, 0.001, 0.002)
    path.write_text(json.dumps({**data, "ftheta_p0": 0.1}))
    with pytest.raises(InputError, match="its f-theta lens is not supported"):
        read(path, camera=None)


@pytest.mark.parametrize("key", ["distortion", "dist_coeffs"])
@pytest.mark.parametrize("kind", ["transforms", "polycam_keyframes", "splatting"])
def test_lists_of_coefficients_of_unknown_order_are_refused(kind, key, tmp_path):
    path = WRITERS[kind].write(tmp_path, make_poses(["a.jpg"]))
    file = path / "a.json" if path.is_dir() else path
    text = file.read_text().replace("{", f'{{"{key}": [0.1, 0, 0, 0], ', 1)
    file.write_text(text)
    with pytest.raises(InputError, match="of unknown order: name its coefficients k1, k2, p1, p2"):
        read(path, camera=None)
    file.write_text(text.replace("[0.1,", "[0,"))
    assert read(path, camera=None).images[0].camera.model == "PINHOLE"


def test_principal_point_of_splatting(tmp_path):
    path = pose_writers.splatting(tmp_path, make_poses(["a.jpg"]))
    path.write_text(path.read_text().replace('"fx"', '"cx": 310.0, "cy": 250.0, "fx"'))
    assert read(path, camera=None).images[0].camera == CAMERA


def test_coefficients_of_blocks_exchange_that_would_be_dropped(tmp_path):
    path = pose_writers.blocks_exchange(tmp_path, make_poses(["a.jpg"]))
    path.write_text(path.read_text().replace("<FocalLength>", "<Distortion><K4>0.1</K4></Distortion><FocalLength>"))
    with pytest.raises(InputError, match="k4"):
        read(path, camera=None)


def test_calibration_of_photoscan(tmp_path):
    """Up to version 1.2, the principal point is from the corner of the photo."""
    path = pose_writers.metashape(tmp_path, truth := make_poses(["a.jpg"]))
    text = path.read_text()
    old = text[text.index("<f>") : text.index("</calibration>")]
    path.write_text(text.replace(old, "<fx>500</fx><fy>510</fy><cx>310</cx><cy>250</cy><skew>0</skew>"))
    posed = read(path, write_named(tmp_path / "photos", list(truth)), camera=None)
    assert posed.images[0].camera == CAMERA


def test_further_models_of_visual_sfm_are_counted(tmp_path, caplog):
    path = pose_writers.nvm(tmp_path, truth := make_poses(["a.jpg", "b.jpg"]))
    text = path.read_text().removesuffix("\n0\n")
    point = "1 2 3 255 255 255 1 0 0 1 1\n"
    path.write_text(f"{text}\n2\n{point}{point}\n3\n" + "c.jpg\t500 1 0 0 0 0 0 0 0 0\n" * 3 + "\n0\n\n0\n")
    assert_poses(read(path), truth)
    assert "3 photos of another model are left out: only the first is read" in caplog.text


def test_spherical_cameras(tmp_path):
    metashape = pose_writers.metashape(tmp_path, make_poses(["a.jpg"]), "spherical")
    opensfm = pose_writers.opensfm(tmp_path, make_poses(["a.jpg"]))
    opensfm.write_text(opensfm.read_text().replace('"brown"', '"spherical"'))
    for path in (metashape, opensfm):
        assert read(path, camera=None).images[0].camera.text() == "EQUIRECTANGULAR 640 480 640.0 480.0"


def test_rational_distortion(tmp_path):
    path = pose_writers.transforms(tmp_path, make_poses(["a.jpg"]))
    more = {"camera_model": "FULL_OPENCV", "k1": 0.1, "k4": 0.4, "k5": 0.5, "k6": 0.6, "p1": 0.01}
    path.write_text(json.dumps({**json.loads(path.read_text()), **more}))
    camera = read(path, camera=None).images[0].camera
    assert camera.params == (500, 510, 310, 250, 0.1, 0, 0.01, 0, 0, 0.4, 0.5, 0.6)


@pytest.mark.parametrize("has_place", [True, False])
def test_rig_of_metashape(has_place, tmp_path, caplog):
    """The cameras of the second sensor have a master, and the sensor a place beside the master's."""
    masters = make_poses(["a_1.jpg", "b_1.jpg"])
    path = pose_writers.metashape(tmp_path, masters)
    turn, vector = Rotation.from_euler("y", 30, degrees=True).as_matrix(), np.array([0.2, 0, 0.1])
    place = (
        f"<rotation>{pose_writers.row(turn.ravel())}</rotation><translation>{pose_writers.row(vector)}</translation>"
    )
    text = path.read_text()
    sensor = text[text.index('<sensor id="0"') : text.index("</sensors>")]
    slave = sensor.replace('id="0"', 'id="1" master_id="0"').replace("</sensor>", place * has_place + "</sensor>")
    slaves = "".join(f'<camera id="{10 + i}" sensor_id="1" master_id="{i}" label="{n}_2"/>' for i, n in enumerate("ab"))
    path.write_text(text.replace("</sensors>", f"{slave}</sensors>").replace("</cameras>", f"{slaves}</cameras>"))
    truth = dict(masters)
    if has_place:
        truth |= {f"{n}_2.jpg": (r @ turn, c + r @ vector) for n, (r, c) in zip("ab", masters.values(), strict=True)}
    assert_poses(read(path, write_named(tmp_path / "p", ["a_1.jpg", "a_2.jpg", "b_1.jpg", "b_2.jpg"])), truth)
    assert ("master_id" in caplog.text) != has_place


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quaternion_order": "xyzw"}, "--quaternion_order xyzw: the file has no quaternions"),
        ({"crs": UTM}, "--crs EPSG:32632.*says itself"),
        ({"calibration_path": "x.yaml"}, "--calibration x.yaml: is for trajectories"),
    ],
)
def test_options_without_effect_are_refused(options, message, tmp_path):
    path = pose_writers.opensfm(tmp_path, make_poses(["a.jpg"]), (47, 8, 0))
    with pytest.raises(InputError, match=message):
        read(path, **options)


@pytest.mark.parametrize(
    "words",
    [
        ["exif", "--crs", UTM],
        ["exif", "--camera_axes", "opengl"],
        ["panoramas", "--crs", UTM],
        ["transforms", "--model", "m"],
        ["transforms", "--poses", "p"],
    ],
)
def test_options_of_other_formats_are_refused(words, tmp_path, capsys):
    form, *more = words
    assert import_poses.main([form, str(tmp_path), "--output_path", str(tmp_path / "out"), *more]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"{more[0]}: has no effect with the format {form}" in error


@pytest.mark.parametrize("written", ["cam_from_world", "opencv", "xyzw"])
def test_options_mend_a_file_that_is_written_otherwise(written, tmp_path):
    truth = make_poses(["a.jpg", "b.jpg"])
    if written == "cam_from_world":
        inverse = {name: (r.T, -r.T @ c) for name, (r, c) in truth.items()}
        path = pose_writers.transforms(tmp_path, {n: (r @ pose_writers.OPENGL, c) for n, (r, c) in inverse.items()})
        posed = read(path, pose_direction="cam_from_world", camera_axes="opencv")
    elif written == "opencv":
        path = pose_writers.transforms(tmp_path, {n: (r @ pose_writers.OPENGL, c) for n, (r, c) in truth.items()})
        posed = read(path, camera_axes="opencv")
    else:
        rows = [(name, c, xyzw(r)) for name, (r, c) in truth.items()]
        posed = read(table(tmp_path, "a.csv", "name,x,y,z,qw,qx,qy,qz", rows), quaternion_order="xyzw")
    assert_poses(posed, truth)


# ---------------------------------------------------------------- placeholders and single bad items


def test_axes_with_a_scale(tmp_path):
    """The scale of axes has no meaning; that of a whole matrix cam_from_world is one of the world."""
    truth = make_poses(["a.jpg", "b.jpg"])
    path = pose_writers.transforms(tmp_path, truth)
    data = json.loads(path.read_text())
    matrix = np.array(data["frames"][0]["transform_matrix"])
    data["frames"][0]["transform_matrix"] = (matrix @ np.diag([0.25, 0.25, 0.25, 1])).tolist()
    path.write_text(json.dumps(data))
    assert_poses(read(path), truth)


@pytest.mark.parametrize("value", ["", "nan", "-inf", "null", "N/A"])
def test_missing_values_of_a_row(value, tmp_path, caplog):
    path = save(
        tmp_path, "a.csv", f"name,lat,lon,alt,yaw,pitch,roll\na.jpg,47,8,400,1,2,3\nb.jpg,47,{value},400,1,2,3\n"
    )
    posed = read(path)
    assert [image.name for image in posed.images] == ["a.jpg"] and posed.origin == GeoOrigin(47, 8, 400)
    assert "1 of 2 poses is left out: line 3: there is no longitude" in caplog.text


def test_coordinate_whose_square_is_infinite_is_left_out(tmp_path, caplog):
    text = "name,x,y,z,qw,qx,qy,qz\na.jpg,1,2,3,1,0,0,0\nb.jpg,1e200,2,3,1,0,0,0\n"
    posed = read(save(tmp_path, "a.csv", text))
    assert [image.name for image in posed.images] == ["a.jpg"]
    assert "1 of 2 poses is left out: b.jpg: a pose has the value 1e+200" in caplog.text


def test_position_without_a_fix(tmp_path, caplog):
    text = "name,lat,lon,alt,yaw,pitch,roll\na.jpg,47,8,400,1,2,3\nb.jpg,0,0,0,1,2,3\nc.jpg,95,8,0,1,2,3\n"
    posed = read(save(tmp_path, "a.csv", text))
    assert [image.name for image in posed.images] == ["a.jpg"] and posed.origin == GeoOrigin(47, 8, 400)
    assert "2 of 3 poses are left out: b.jpg: its position is missing" in caplog.text


def write_gps(path, **values):
    """Writes a photo with GPS; `values`: those that are not ordinary, by the numbers of EXIF's fields."""
    exif = PIL.Image.Exif()
    gps = {1: "N", 2: (47, 22, 36.84), 3: "E", 4: (8, 32, 30.12), 5: b"\0", 6: 408.0}
    exif.get_ifd(0x8825).update({**gps, **{int(key[1:]): value for key, value in values.items()}})
    exif[0x8825] = exif.get_ifd(0x8825)
    path.parent.mkdir(exist_ok=True)
    PIL.Image.new("L", (32, 24)).save(path, exif=exif)


def test_placeholders_in_exif(tmp_path, capsys):
    unknown = PIL.TiffImagePlugin.IFDRational(0, 0)
    folder = tmp_path / "photos"
    write_gps(folder / "a.jpg")
    write_gps(folder / "altitude.jpg", f6=unknown)
    write_gps(folder / "accuracy.jpg", f31=unknown)
    write_gps(folder / "far.jpg", f31=999999.0)
    write_gps(folder / "no_fix.jpg", f2=(0, 0, 0), f4=(0, 0, 0))
    write_gps(folder / "nan.jpg", f2=(unknown, unknown, unknown))
    words = ["exif", str(folder), "--output_path", str(tmp_path / "gps.txt")]
    assert import_poses.main(words) == 0
    lines = [line.split() for line in (tmp_path / "gps.txt").read_text().splitlines()]
    assert [line[0] for line in lines] == ["a.jpg", "accuracy.jpg", "altitude.jpg", "far.jpg"]
    assert all(line[4:] == ["5", "5", "50"] and abs(float(line[3])) < 1e-6 for line in lines)
    assert "2 of 6 photos have no GPS" in capsys.readouterr().err


def test_photos_on_both_sides_of_180_degrees(tmp_path):
    write_gps(tmp_path / "photos" / "east.jpg", f4=(179, 59, 59.5))
    write_gps(tmp_path / "photos" / "west.jpg", f3="W", f4=(179, 59, 59.5))
    path = tmp_path / "gps.txt"
    assert import_poses.main(["exif", str(tmp_path / "photos"), "--output_path", str(path)]) == 0
    assert all(abs(float(line.split()[1])) < 11 for line in path.read_text().splitlines())
    assert abs(GeoOrigin.read(tmp_path).longitude_deg) == pytest.approx(180)


def test_what_is_left_out_is_one_line(tmp_path, capsys):
    """One frame has lost tracking, as phones write it; the others are written."""
    names = [f"IMG_{index:04}.jpg" for index in range(5)]
    truth = make_poses(names)
    path = pose_writers.transforms(tmp_path, truth)
    data = json.loads(path.read_text())
    data["frames"][2]["transform_matrix"] = [[float("-inf")] * 4] * 4
    data["frames"][3] = None
    path.write_text(json.dumps(data))
    assert import_poses.main(["auto", str(path), "--output_path", str(tmp_path / "model")]) == 0
    assert sorted(read_model(tmp_path / "model").images) == [f"images/{names[index]}" for index in (0, 1, 4)]
    error = capsys.readouterr().err
    assert (
        error.count("\n") == 1
        and "2 of 5 poses are left out: " in error
        and "IMG_0002.jpg: a pose has a value" in error
    )


# ---------------------------------------------------------------- further files of these kinds


def named_rows(truth, *columns):
    """Returns rows for pose_writers.table: names, and what functions of rotation and centre give."""
    return [(name, *(column(*pose) for column in columns)) for name, pose in truth.items()]


def test_centre_beside_a_translation_is_refused(tmp_path):
    """The rotations belong to one of them."""
    rows = named_rows(make_poses(["a.jpg"]), lambda r, c: pose_writers.wxyz(r.T), lambda r, c: -r.T @ c, lambda r, c: c)
    path = table(tmp_path, "a.csv", "name,qw,qx,qy,qz,tx,ty,tz,x,y,z", rows)
    with pytest.raises(InputError, match="has x, y, z .* and tx, ty, tz"):
        read(path)


@pytest.mark.parametrize(("south", "west"), [("S", "W"), ("South", "West"), ("N", "E"), ("", "")])
def test_letters_of_the_hemisphere_are_used(south, west, tmp_path, caplog):
    """As exiftool writes them, beside values with or without their signs."""
    header = "SourceFile,GPSLatitude,GPSLatitudeRef,GPSLongitude,GPSLongitudeRef,GPSAltitude,yaw,pitch,roll\n"
    path = save(tmp_path, "a.csv", f"{header}a.jpg,33.5,{south},70.1,{west},600,0,0,0\n")
    sign = -1 if south[:1] == "S" else 1
    assert read(path).origin == GeoOrigin(sign * 33.5, sign * 70.1, 600.0) and "not used" not in caplog.text


def test_line_of_units_is_refused(tmp_path):
    path = save(tmp_path, "a.csv", "name,x,y,z,qw,qx,qy,qz\n,mm,mm,mm,-,-,-,-\na.jpg,1,2,3,1,0,0,0\n")
    with pytest.raises(InputError, match="has a line of units"):
        read(path)


@pytest.mark.parametrize("kind", ["xmp", "blocks"])
def test_photos_of_other_components_are_left_out(kind, tmp_path, caplog):
    """Coordinates of components that are not connected have nothing in common."""
    truth = make_poses([f"{index}.jpg" for index in range(5)])
    photos = write_named(tmp_path / "photos", truth)
    if kind == "xmp":
        path = pose_writers.xmp(tmp_path, truth)
        for index, file in enumerate(sorted(path.iterdir())):
            part = f'xcr:Coordinates="relative" xcr:ComponentId="{{{index // 3}}}"'
            file.write_text(file.read_text().replace('xcr:Coordinates="absolute"', part))
    else:
        path = pose_writers.blocks_exchange(tmp_path, truth)
        *parts, last = path.read_text().split("</Pose>")
        parts = [f"{part}</Pose><Component>{index // 3}</Component>" for index, part in enumerate(parts)]
        path.write_text("".join([*parts, last]))
    assert len(read(path, photos).images) == 3 and "2 photos of 1 other components are left out" in caplog.text


def test_components_with_absolute_coordinates_are_read(tmp_path):
    truth = make_poses(["0.jpg", "1.jpg"])
    path = pose_writers.xmp(tmp_path, truth)
    for file in path.iterdir():
        file.write_text(file.read_text().replace("xcr:Skew", f'xcr:ComponentId="{file.stem}" xcr:Skew'))
    assert len(read(path, write_named(tmp_path / "photos", truth)).images) == 2


@pytest.mark.parametrize("height", ["-9999", "-32768", "99999"])
def test_heights_that_mean_nothing_are_missing(height, tmp_path, caplog):
    text = f"name,lat,lon,alt,yaw,pitch,roll\na.jpg,47,8,400,0,0,0\nb.jpg,47,8,{height},0,0,0\n"
    posed = read(save(tmp_path, "a.csv", text))
    assert [image.name for image in posed.images] == ["a.jpg"] and posed.origin == GeoOrigin(47.0, 8.0, 400.0)
    assert "b.jpg: its position is missing" in caplog.text


def test_place_without_a_fix_in_a_grid_is_missing(tmp_path):
    text = "name,x,y,z,yaw,pitch,roll\na.jpg,447000,5247000,400,0,0,0\nb.jpg,0,0,0,0,0,0\n"
    posed = read(save(tmp_path, "a.csv", text), crs=UTM)
    assert [image.name for image in posed.images] == ["a.jpg"] and 47 < posed.origin.latitude_deg < 48


@pytest.mark.parametrize("line", ["abc set/9.png", "nan set/9.png", "1234.6"])
def test_bad_line_in_a_list_of_times(line, tmp_path, caplog):
    """The others are used, which are not in the order of the names."""
    truth = make_poses([f"{index:06}.png" for index in range(5)])
    path = pose_writers.tum(tmp_path, truth)
    names = sorted(truth, reverse=True)
    times = [f"{pose_writers.TIME + pose_writers.STEP * index} {name}" for index, name in enumerate(names)]
    save(tmp_path, "rgb.txt", "\n".join([*times[:2], line, *times[2:]]))
    expected = dict(zip(names, truth.values(), strict=True))
    assert_poses(read(path, write_named(tmp_path / "photos", truth)), expected)
    assert ("1 of 6 lines have no time" in caplog.text) == (" " in line)


@pytest.mark.parametrize("kind", ["xmp", "polycam"])
def test_first_file_of_a_folder_is_damaged(kind, tmp_path, caplog):
    truth = make_poses(["0.jpg", "1.jpg"])
    path = (pose_writers.xmp if kind == "xmp" else pose_writers.polycam_keyframes)(tmp_path, truth)
    min(path.iterdir()).write_text("{")
    assert [image.name for image in read(path, write_named(tmp_path / "photos", truth)).images] == ["1.jpg"]
    assert "1 of 2 poses is left out" in caplog.text


def test_damaged_intrinsics_of_one_photo(tmp_path, caplog):
    names = [f"lowres_wide/41_{pose_writers.TIME + pose_writers.STEP * index:.3f}.png" for index in range(3)]
    truth = make_poses(names)
    path = pose_writers.arkit_scenes(tmp_path, truth)
    min(path.rglob("*.pincam")).write_text("640 480 500")
    posed = read(path, write_named(tmp_path / "photos", truth), camera=None)
    assert len(posed.images) == 3 and ".pincam (there are 3 numbers instead of 6)" in caplog.text


def test_files_of_macos_and_of_network_drives_are_no_photos(tmp_path):
    truth = make_poses([f"{index:06}.jpg" for index in range(3)])
    others = ["._000000.jpg", "__MACOSX/000000.jpg", "@eaDir/000001.jpg/THUMB.jpg", ".thumbnails/000002.jpg"]
    folder = write_named(tmp_path / "photos", [*truth, *others])
    assert_poses(read(pose_writers.kitti(tmp_path, truth), folder), truth)


def test_brackets_without_end_take_no_time(tmp_path):
    with pytest.raises(InputError, match="is not JSON"):
        read(save(tmp_path, "a.json", '{"frames":' + "[" * 60_000))


@pytest.mark.parametrize("kind", ["12scenes", "scannet"])
@pytest.mark.parametrize("shift", [0.0, 0.02])
def test_colour_cameras_beside_the_poses_are_refused(kind, shift, tmp_path):
    names = [
        f"data/frame-{index + 2:06}.color.jpg" if kind == "12scenes" else f"color/{index}.jpg" for index in range(2)
    ]
    truth = make_poses(names)
    path = (pose_writers.twelve_scenes if kind == "12scenes" else pose_writers.scannet)(tmp_path, truth)
    matrix = f"1 0 0 {shift} 0 1 0 0 0 0 1 0 0 0 0 1"
    if kind == "12scenes":
        with (path / "info.txt").open("a") as file:
            file.write(f"m_calibrationColorExtrinsic = {matrix}\n")
    else:
        save(path, "intrinsic/extrinsic_color.txt", matrix + "\n")
    photos = write_named(tmp_path / "photos", truth)
    if shift:
        with pytest.raises(InputError, match="moves the colour camera against the poses"):
            read(path, photos)
    else:
        assert_poses(read(path, photos), truth)


@pytest.mark.parametrize(("folder", "focal"), [("cam0/data", 500), ("cam1/data", 700), ("photos", 500)])
def test_camera_of_kalibr_is_that_of_the_folder(folder, focal, tmp_path, caplog):
    truth = make_poses([f"{index:06}.png" for index in range(2)])
    camera = "  camera_model: pinhole\n  resolution: [640, 480]\n  intrinsics: [F, F, 320, 240]\n"
    camera += "  T_cam_imu: [[1, 0, 0, X], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    cameras = [camera.replace("F", number).replace("X", shift) for number, shift in (("500", "0"), ("700", "-0.1"))]
    calibration = save(tmp_path, "camchain.yaml", f"cam0:\n{cameras[0]}cam1:\n{cameras[1]}")
    path = pose_writers.tum(tmp_path, truth)
    posed = read(path, write_named(tmp_path / folder, truth), camera=None, calibration_path=calibration)
    assert posed.images[0].camera.params[0] == focal
    shift = 0.1 if focal == 700 else 0.0
    for image in posed.images:
        r, c = truth[image.name]
        assert np.allclose(image.cam_from_world.cam_in_world, c + r @ [shift, 0, 0])
    other = "cam0" if focal == 700 else "cam1"
    assert f"keys that are not used: {other}" in caplog.text

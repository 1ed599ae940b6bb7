"""Tests of lazyloc import: each format with a camera whose pose and axes are known, and damaged files of each."""

import json
import math

import numpy as np
import PIL.Image
import pyproj
import pytest
from scipy.spatial.transform import Rotation

import pose_files
import pose_writers
from colmap_lazyloc import import_poses
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.registry import find_format, read_posed_images

NORTHWARD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # cam_from_world of the camera in pose_files


@pytest.fixture(scope="session")
def photos(tmp_path_factory):
    return pose_files.write_photos(tmp_path_factory.mktemp("photos"))


def read(path, photos, needs_camera=False, form=None, **options):
    source = pose_files.source_of(path, photos, needs_camera)
    source = Source(**{**source.__dict__, **options})
    posed = read_posed_images(source, form)
    return {image.name: image for image in posed.images}, posed.origin


def assert_looks_north(image, centre=pose_files.CENTRE, tolerance=1e-9):
    """Checks the axes with a point 10 m ahead, 1 m to the right and 2 m above the camera."""
    point = np.asarray(centre) + (1, 10, 2)
    assert np.allclose(image.cam_from_world(point[None])[0], (1, -2, 10), atol=tolerance)
    assert np.allclose(image.cam_from_world.cam_in_world, centre, atol=tolerance)


@pytest.mark.parametrize("name", pose_files.FILES)
def test_pose_axes_and_intrinsics(name, photos, tmp_path):
    write, form, needs_camera = pose_files.FILES[name]
    path = write(tmp_path)
    assert find_format(path) == form
    images, origin = read(path, photos, needs_camera, form)
    by_time = name in ("arkit", "arkit_matrix", "arcore", "tum", "kitti")
    image = images[pose_files.TIMED[0] if by_time else pose_files.NAME]
    assert_looks_north(image)
    assert image.camera.text() == Camera.parse("", pose_files.TEXT_CAMERA).text()
    other = images[pose_files.TIMED[1] if by_time else pose_files.OTHER]
    assert np.allclose(other.cam_from_world.cam_in_world, (12, 20, 5))
    assert (origin is not None) == (name == "opensfm")


def test_model_is_written_and_read(photos, tmp_path, capsys):
    path = pose_files.opensfm(tmp_path)
    for form, flags in (("auto", []), ("opensfm", ["--binary"])):
        words = [form, str(path), "--output_path", str(tmp_path / "model"), "--image_path", str(photos), *flags]
        assert import_poses.main(words) == 0
        model = read_model(tmp_path / "model")
        assert sorted(model.images) == [pose_files.NAME, pose_files.OTHER] and len(model.cameras) == 1
        assert_looks_north(model.images[pose_files.NAME])
        assert len(list((tmp_path / "model").iterdir())) == 4
    assert json.loads((tmp_path / "model" / "geo.json").read_text()) == {
        "latitude_deg": 47.0,
        "longitude_deg": 8.0,
        "height_m": 400.0,
        "frame": "ENU",
        "ellipsoid": "WGS84",
    }
    assert "2 images, 1 camera\n" in capsys.readouterr().out


def test_intrinsics_of_a_frame_and_of_a_field_of_view(photos, tmp_path):
    path = pose_files.transforms(tmp_path)
    data = json.loads(path.read_text())
    for key in ("fl_x", "fl_y", "w", "h", "cx", "cy", "k1", "camera_model"):
        del data[key]
    data["camera_angle_x"] = 2 * math.atan(320 / 700)  # as in NeRF's synthetic scenes, whose names have no ending
    data["frames"][0]["file_path"] = f"./{pose_files.NAME[:-4]}"
    data["frames"][1] |= {"fl_x": 400, "fl_y": 401, "camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k4": 0.2}
    path.write_text(json.dumps(data))
    images, _ = read(path, photos)
    assert images[pose_files.NAME].camera == Camera(
        "PINHOLE", 640, 480, (pytest.approx(700), pytest.approx(700), 320, 240)
    )
    fisheye = Camera("OPENCV_FISHEYE", 640, 480, (400, 401, 320, 240, 0.1, 0, 0, 0.2))
    assert images[pose_files.OTHER].camera == fisheye


def test_angles_turn_as_an_aircraft_does(photos, tmp_path):
    """Looks east, 30 degrees down; then 90 degrees down with the top of the image to the east."""
    path = pose_files.write(
        tmp_path, "a.csv", "name,x,y,z,yaw,pitch,roll\nphoto 1,0,0,0,90,-30,0\nphoto 2,0,0,0,90,-90,0\n"
    )
    images, _ = read(path, photos, needs_camera=True)
    forward = images[pose_files.NAME].cam_from_world.rotation[2]
    assert np.allclose(forward, (math.cos(math.pi / 6), 0, -0.5))
    right, down, forward = images[pose_files.OTHER].cam_from_world.rotation
    assert np.allclose(forward, (0, 0, -1)) and np.allclose(down, (-1, 0, 0)) and np.allclose(right, (0, -1, 0))
    path = pose_files.write(tmp_path, "a.csv", "name,x,y,z,yaw,pitch,roll\nphoto 1,0,0,0,0,0,90\n")
    images, _ = read(path, photos, needs_camera=True)
    assert np.allclose(images[pose_files.NAME].cam_from_world.rotation[0], (0, 0, -1))  # the right side is down


def test_reality_capture_is_as_its_own_xmp(photos, tmp_path):
    """The angles and the matrix are those that RealityCapture itself exported of one camera, as CSV and as XMP."""
    heading, pitch, roll = 163.736597399311, 83.4154313461628, 174.386496244756
    row = f"photo 1.jpg,1,2,3,{heading},{pitch},{roll},35,0,0,0,0,0,0,0,0\n"
    header = "#cameras 1\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n"
    images, _ = read(pose_files.write(tmp_path, "rc.csv", header + row), photos)
    rotation = [
        [0.982594073038806, 0.185426733553445, -0.0112166890261935],
        [-0.032113633044729, 0.11008102707942, -0.993403685341366],
        [-0.18296885582437, 0.976472781986697, 0.114],  # the last number is rounded in the export
    ]
    assert np.allclose(images[pose_files.NAME].cam_from_world.rotation, rotation, atol=2e-4)


def geodetic(points, origin=pose_files.ORIGIN):
    """Returns latitude, longitude and height of points in a local frame, by another way than the project's."""
    latitude, longitude = np.radians(origin[:2])
    rotation = Rotation.from_euler("ZX", [math.pi / 2 + longitude, math.pi / 2 - latitude]).as_matrix()
    to_geocentric = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    centre = np.array(to_geocentric.transform(origin[1], origin[0], origin[2]))
    geocentric = np.asarray(points) @ rotation.T + centre
    longitudes, latitudes, heights = to_geocentric.transform(*geocentric.T.tolist(), direction="INVERSE")
    return np.stack([latitudes, longitudes, heights], axis=1), geocentric, rotation


def test_table_in_latitude_and_longitude(photos, tmp_path):
    places, _, _ = geodetic([pose_files.CENTRE, pose_files.CENTRE + (2, 0, 0)])
    rows = [
        f"{n},{a:.10f},{b:.10f},{c:.6f},0,0,0\n" for n, (a, b, c) in zip((pose_files.NAME, pose_files.OTHER), places)
    ]
    path = pose_files.write(tmp_path, "a.csv", "image,latitude,longitude,height,yaw,pitch,roll\n" + "".join(rows))
    images, origin = read(path, photos, needs_camera=True, origin=GeoOrigin(*pose_files.ORIGIN))
    assert origin == GeoOrigin(*pose_files.ORIGIN)
    assert_looks_north(images[pose_files.NAME], tolerance=1e-4)
    images, origin = read(path, photos, needs_camera=True)  # around the mean of the cameras
    centres = np.array([image.cam_from_world.cam_in_world for image in images.values()])
    assert np.allclose(centres, [(-1, 0, 0), (1, 0, 0)], atol=2e-3)
    assert np.allclose(origin.to_geodetic(centres)[:, :2], places[:, :2], atol=1e-9)


def test_latitude_and_longitude_beside_quaternions_cam_from_world(photos, tmp_path):
    """Degrees are the camera's place, and no translation, whatever the direction of the rotations is."""
    ((latitude, longitude, height),), _, _ = geodetic([pose_files.CENTRE])
    x, y, z, w = Rotation.from_matrix(NORTHWARD).as_quat()
    row = f"{pose_files.NAME},{latitude:.10f},{longitude:.10f},{height:.6f},{w:.12f},{x:.12f},{y:.12f},{z:.12f}\n"
    path = pose_files.write(tmp_path, "a.csv", "name,lat,lon,alt,qw,qx,qy,qz\n" + row)
    options = {"pose_direction": "cam_from_world", "origin": GeoOrigin(*pose_files.ORIGIN)}
    images, _ = read(path, photos, needs_camera=True, **options)
    assert_looks_north(images[pose_files.NAME], tolerance=1e-4)


def test_grid_north_is_not_north(photos, tmp_path):
    """UTM's grid is turned by some degrees against north, away from the central meridian."""
    place = geodetic([pose_files.CENTRE], (60.0, 8.0, 100.0))[0][0]  # central meridian: 9 degrees
    x, y = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform(place[1], place[0])
    convergence = math.degrees(math.atan(math.tan(math.radians(8 - 9)) * math.sin(math.radians(60))))
    row = f"{pose_files.NAME},{x:.9f},{y:.9f},{place[2]:.9f},{-convergence:.9f},0,0\n"
    path = pose_files.write(tmp_path, "a.csv", "name,x,y,z,yaw,pitch,roll\n" + row)
    images, _ = read(path, photos, needs_camera=True, crs="EPSG:32632", origin=GeoOrigin(60.0, 8.0, 100.0))
    assert_looks_north(images[pose_files.NAME], tolerance=1e-3)


def test_metashape_in_geographic_coordinates(photos, tmp_path):
    """The chunk is scaled by 4, and its axes are those of the local frame."""
    _, (centre,), rotation = geodetic([(0, 0, 0)])
    transform = f"""<transform><rotation>{" ".join(map(repr, rotation.ravel().tolist()))}</rotation>
<translation>{" ".join(map(repr, centre.tolist()))}</translation><scale>4</scale></transform>"""
    poses = {pose_files.NAME: [1, 0, 0, 2.5, 0, 0, 1, 5, 0, -1, 0, 1.25]}
    path = pose_files.metashape(tmp_path, transform, 'GEOGCS["WGS 84"]', poses)
    images, origin = read(path, photos, origin=GeoOrigin(*pose_files.ORIGIN))
    assert_looks_north(images[pose_files.NAME], tolerance=1e-6)
    assert read(path, photos)[1] is not None and origin == GeoOrigin(*pose_files.ORIGIN)


def test_metashape_distortion_has_another_order(photos, tmp_path):
    path = pose_files.metashape(tmp_path)
    path.write_text(path.read_text().replace("<k1>", "<p1>0.001</p1><p2>0.002</p2><b1>3</b1><k3>0.1</k3><k1>"))
    camera = next(iter(read(path, photos)[0].values())).camera
    assert camera == Camera("FULL_OPENCV", 640, 480, (503, 500, 310, 250, -0.05, 0, 0.002, 0.001, 0.1, 0, 0, 0))
    path.write_text(path.read_text().replace("<k1>", "<k4>0.1</k4><k1>"))
    with pytest.raises(InputError, match="k4"):
        read(path, photos)


def test_trajectory_of_a_body_with_a_calibration(photos, tmp_path, caplog):
    """The body's axes are forward, left, up, as of a robot. The camera is 0.3 m ahead of it and 0.1 m above."""
    path = pose_files.write(tmp_path, "t.txt", "1700000100.0 0 0 0 0 0 0.70710678118 0.70710678118\n")  # faces north
    calibration = pose_files.write(
        tmp_path,
        "sensor.yaml",
        "%YAML:1.0\nT_BS:\n  rows: 4\n  cols: 4\n  data: [0, 0, 1, 0.3, -1, 0, 0, 0, 0, -1, 0, 0.1, 0, 0, 0, 1]\n"
        "resolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [500, 500, 309.5, 249.5]\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [-0.05, 0, 0, 0]\n",
    )
    images, _ = read(path, photos, calibration_path=calibration)
    assert_looks_north(images[pose_files.TIMED[0]], (0, 0.3, 0.1))
    assert images[pose_files.TIMED[0]].camera.text() == Camera.parse("", pose_files.TEXT_CAMERA).text()
    calibration = pose_files.write(
        tmp_path,
        "camchain.yaml",
        "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.1, 0, 0, 0.2]\n  distortion_model: equidistant\n"
        "  intrinsics: [500, 500, 309.5, 249.5]\n  resolution: [640, 480]\n"
        "  T_cam_imu:\n  - [0, -1, 0, 0]\n  - [0, 0, -1, 0.1]\n  - [1, 0, 0, -0.3]\n  - [0, 0, 0, 1]\n"
        "  timeshift_cam_imu: 0.02\ncam1:\n  camera_model: pinhole\n",
    )
    assert "not used" not in caplog.text
    images, _ = read(path, photos, calibration_path=calibration)
    assert_looks_north(images[pose_files.TIMED[0]], (0, 0.3, 0.1))
    assert images[pose_files.TIMED[0]].camera.model == "OPENCV_FISHEYE"
    assert f"{calibration}: keys that are not used: cam1, timeshift_cam_imu" in caplog.text


def test_kitti_calibration_of_the_photos_camera(tmp_path):
    folder = tmp_path / "image_2"
    folder.mkdir()
    PIL.Image.new("L", pose_files.SIZE).save(folder / "000000.png")
    poses = pose_files.write(tmp_path, "00.txt", "1 0 0 10 0 0 1 20 0 -1 0 5\n")
    rows = "P0: 500 0 309.5 0 0 500 249.5 0 0 0 1 0\nP2: 500 0 309.5 -250 0 500 249.5 0 0 0 1 0\nTr: 1\n"
    images, _ = read(poses, folder, calibration_path=pose_files.write(tmp_path, "calib.txt", rows))
    assert_looks_north(images["000000.png"], (10.5, 20, 5))  # half a metre to the right of camera 0


def test_kitti_360_calibration_of_the_photos_camera(tmp_path):
    """The body's axes are x forward, y right, z down; the camera is 1.5 m ahead of it."""
    truth = pose_writers.make_poses(["0000000000.png", "0000000001.png"])
    folder = pose_files.write_named(tmp_path / "image_01" / "data_rect", truth)
    axes = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the camera's in the body's
    body = {name: (r @ axes.T, c - r @ axes.T @ (1.5, 0, 0)) for name, (r, c) in truth.items()}
    path = pose_writers.kitti360(tmp_path, body).rename(tmp_path / "poses.txt")
    rows = "image_00: 1 0 0 0 0 1 0 0 0 0 1 0\nimage_01: 0 0 1 1.5 1 0 0 0 0 1 0 0\n"
    calibration = pose_files.write(tmp_path, "calib_cam_to_pose.txt", rows)
    pose_files.assert_poses(pose_files.read(path, folder, calibration_path=calibration), truth)
    with pytest.raises(InputError, match="its poses are of the body: give --calibration"):
        pose_files.read(path, folder)


def test_poses_between_two_times(photos, tmp_path):
    """The photo is taken a quarter of the way between two poses, and named by nanoseconds."""
    folder = tmp_path / "frames"
    folder.mkdir()
    PIL.Image.new("L", pose_files.SIZE).save(folder / "1403636579763555584.png")
    PIL.Image.new("L", pose_files.SIZE).save(folder / "1403636589763555584.png")  # 10 s later, in a gap
    rows = [(1403636579.738555584, 0, 0), (1403636579.838555584, 4, 40), (1403636591.0, 9, 0)]
    text = "".join(
        f"{time!r} {x} 0 0 0 0 {math.sin(math.radians(a) / 2)} {math.cos(math.radians(a) / 2)}\n" for time, x, a in rows
    )
    images, _ = read(pose_files.write(tmp_path, "t.txt", text), folder, needs_camera=True)
    (image,) = images.values()
    assert image.name == "1403636579763555584.png"
    assert np.allclose(image.cam_from_world.cam_in_world, (1, 0, 0), atol=1e-4)
    angle_deg = Rotation.from_matrix(image.cam_from_world.rotation.T).as_rotvec(degrees=True)[2]
    assert angle_deg == pytest.approx(10, abs=1e-3)


def test_photos_of_two_cameras_at_one_time_are_refused(tmp_path):
    """They would all get the pose of one camera."""
    for side in ("left", "right"):
        (tmp_path / "rig" / side).mkdir(parents=True)
        PIL.Image.new("L", pose_files.SIZE).save(tmp_path / "rig" / side / "100.5.png")
    path = pose_files.write(tmp_path, "t.txt", "100.5 1 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match="left/100.5.png and right/100.5.png have the same time"):
        read(path, tmp_path / "rig", needs_camera=True)
    images, _ = read(path, tmp_path / "rig" / "left", needs_camera=True)
    assert np.allclose(images["100.5.png"].cam_from_world.cam_in_world, (1, 0, 0))


RIG = [
    {"image_prefix": "left/", "ref_sensor": True},
    {
        "image_prefix": "right/",
        "cam_from_rig_rotation": [math.sqrt(0.5), 0, 0, math.sqrt(0.5)],
        "cam_from_rig_translation": [-0.5, 0, 0],
        "camera_model_name": "SIMPLE_PINHOLE",
        "camera_params": [20, 16, 12],
    },
]


def import_rig(tmp_path, rigs, form="tum", text="100.5 1 0 0 0 0 0 1\n101 2 0 0 0 0 0 1\n"):
    for name in ("left/100.5.png", "right/100.5.png", "left/101.png", "right/102.png"):
        (tmp_path / "rig" / name).parent.mkdir(parents=True, exist_ok=True)
        PIL.Image.new("L", (32, 24)).save(tmp_path / "rig" / name)
    path = pose_files.write(tmp_path, "poses.txt", text)
    (tmp_path / "rig.json").write_text(json.dumps(rigs))
    words = [form, str(path), "--image_path", str(tmp_path / "rig"), "--output_path", str(tmp_path / "model")]
    return import_poses.main(
        [*words, "--rig_config_path", str(tmp_path / "rig.json"), "--camera", "PINHOLE 32 24 9 9 16 12"]
    )


@pytest.mark.parametrize("form", ["tum", "kitti"])
def test_all_cameras_of_a_rig_get_poses(form, tmp_path, capsys):
    """The trajectory is that of the left camera; a photo at a time without a left one has no pose."""
    kitti = "1 0 0 1 0 1 0 0 0 0 1 0\n1 0 0 2 0 1 0 0 0 0 1 0\n"
    assert import_rig(tmp_path, [{"cameras": RIG}], form, *([kitti] if form == "kitti" else [])) == 0
    model = read_model(tmp_path / "model")
    assert sorted(model.images) == ["left/100.5.png", "left/101.png", "right/100.5.png"]
    right = model.images["right/100.5.png"]
    assert np.allclose(model.images["left/100.5.png"].pose.cam_in_world, (1, 0, 0))
    # The right camera is rolled by 90 degrees about the viewing direction, and 0.5 away from the left one.
    assert np.allclose(right.pose.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.allclose(right.pose.cam_in_world, (1, -0.5, 0))
    assert model.cameras[right.camera_id].text() == "SIMPLE_PINHOLE 32 24 20.0 16.0 12.0"
    assert model.cameras[model.images["left/101.png"].camera_id].model == "PINHOLE"
    assert "1 of 4 photos have no pose" in capsys.readouterr().err


WITHOUT_MODEL = {key: value for key, value in RIG[1].items() if key != "camera_model_name"}


@pytest.mark.parametrize(
    "rigs",
    [
        *([], {}, [{"cameras": RIG}] * 2),
        *([{"cameras": cameras}] for cameras in (RIG[1:], RIG[:1] * 2, [RIG[0], WITHOUT_MODEL])),
    ],
)
def test_bad_rig_is_one_line(rigs, tmp_path, capsys):
    assert import_rig(tmp_path, rigs) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "--rig_config_path" in error and "one rig with one ref_sensor" in error


def write_gps(path, latitude, longitude, altitude):
    photo = PIL.Image.new("L", (32, 24))
    exif = photo.getexif()
    gps = exif.get_ifd(0x8825)

    def degrees(value):
        return int(abs(value)), int(abs(value) * 60 % 60), abs(value) * 3600 % 60

    gps[1], gps[2] = "S" if latitude < 0 else "N", degrees(latitude)
    gps[3], gps[4] = "W" if longitude < 0 else "E", degrees(longitude)
    gps[5], gps[6] = b"\0", altitude
    exif[0x8825] = gps
    photo.save(path, exif=exif)


def test_positions_of_exif(tmp_path, capsys):
    folder = tmp_path / "photos"
    folder.mkdir()
    places, _, _ = geodetic([(10, 20, 5), (-30, 0, 2)], (-33.5, -70.5, 500.0))
    for index, place in enumerate(places):
        write_gps(folder / f"{index}.jpg", *place)
    PIL.Image.new("L", (32, 24)).save(folder / "none.jpg")
    GeoOrigin(-33.5, -70.5, 500.0).write(tmp_path)
    words = ["exif", str(folder), "--output_path", str(tmp_path / "gps.txt"), "--model", str(tmp_path)]
    assert import_poses.main(words) == 0
    lines = [line.split() for line in (tmp_path / "gps.txt").read_text().splitlines()]
    assert [line[0] for line in lines] == ["0.jpg", "1.jpg"]
    assert np.allclose(np.array([line[1:4] for line in lines], float), [(10, 20, 5), (-30, 0, 2)], atol=0.02)
    assert lines[0][4:] == ["5", "5", "50"] and "2 positions" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:100], "is not JSON"),
        (lambda text: text.replace("frames", "views"), "lacks 'frames'"),
        (lambda text: text.replace("[0, 0, -1, ", "[0, 0, -1.5, "), "not a rotation"),
        (lambda text: text.replace("[0, 0, -1, ", "[0, 0, NaN, "), "not finite"),
        (lambda text: text.replace("photo 1", "photo 3").replace("photo 2", "photo 4"), "no photo that it names"),
        (lambda text: text.replace("photo 2", "photo 1"), "two poses belong to 'a/photo 1.jpg'"),
        (lambda text: text.replace('"OPENCV"', '"ORTHOPHOTO"'), "ORTHOPHOTO"),
        (lambda text: text.replace('"k1"', '"k4"'), "k4"),
    ],
)
def test_bad_file_is_one_line(change, message, photos, tmp_path, capsys):
    path = pose_files.transforms(tmp_path)
    path.write_text(change(path.read_text()))
    words = ["transforms", str(path), "--output_path", str(tmp_path / "model"), "--image_path", str(photos)]
    assert import_poses.main(words) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error and str(path) in error
    assert not (tmp_path / "model").exists()

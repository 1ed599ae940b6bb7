"""lazyloc export writes poses that lazyloc import, and readers without any code of the project, read again."""

import csv
import json
import pathlib
import struct
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import cv2
import fastkml.validator
import numpy as np
import PIL.Image
import pycolmap
import pyogrio
import pyproj
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from colmap_lazyloc import __main__ as tool
from colmap_lazyloc.model import Camera, Image, read_model, write_model
from colmap_lazyloc.pose_formats.cameras import coefficients
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import Photos, Source
from colmap_lazyloc.pose_formats.registry import EXPORTS, find_format, read_posed_images, written_formats
from colmap_lazyloc.poses import Pose

SIZE = WIDTH, HEIGHT = 640, 480
PINHOLE = Camera("PINHOLE", *SIZE, (500.0, 510.0, 310.0, 250.0))
SIMPLE = Camera("SIMPLE_RADIAL", *SIZE, (600.0, 330.0, 235.0, -0.05))
OPENCV = Camera("OPENCV", *SIZE, (500.0, 510.0, 310.0, 250.0, -0.1, 0.02, 1e-3, -2e-3))
FISHEYE = Camera("OPENCV_FISHEYE", *SIZE, (300.0, 301.0, 322.0, 238.0, 0.05, -0.01, 2e-3, -1e-3))
FULL = Camera("FULL_OPENCV", *SIZE, (700.0, 700.0, 320.0, 240.0, -0.1, 0.05, 1e-3, 2e-3, -0.01, 0.0, 0.0, 0.0))
SPHERICAL = Camera("EQUIRECTANGULAR", 640, 320, (640.0, 320.0))
ZURICH = GeoOrigin(47.3769, 8.5417, 408.0)
CAPE_HORN = GeoOrigin(-55.98, -67.27, 40.0)
SEQUENCE = tuple(f"query/{number:06d}.jpg" for number in (1, 2, 9, 10, 100))


@dataclass(frozen=True)
class Scene:
    """What a run has localized: the cameras take turns."""

    cameras: tuple[Camera, ...] = (PINHOLE,)
    names: tuple[str, ...] = SEQUENCE
    origin: GeoOrigin | None = None
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


SCENES = {
    "pinhole": Scene(),
    "cameras": Scene((PINHOLE, SIMPLE, OPENCV, FULL)),
    "fisheye": Scene((FISHEYE,)),
    "spherical": Scene((SPHERICAL,)),
    "rig": Scene((OPENCV, FISHEYE), tuple(f"query/{side}/{n:02d}.jpg" for n in (1, 2, 10) for side in ("a", "b"))),
    "geographic": Scene((SIMPLE,), origin=ZURICH),
    "far": Scene((OPENCV,), origin=CAPE_HORN, shift=(-8000.0, 15000.0, 300.0)),
    "large": Scene((PINHOLE,), shift=(500000.0, 5200000.0, 400.0)),
}
GEOGRAPHIC = [name for name, scene in SCENES.items() if scene.origin is not None]
EARTH = ("odmgeo", "geopose", "geoposeypr", "gpkg", "kml")  # formats that need a place on the Earth
NO_CAMERAS = ("tum", "kitti", *EARTH)
FILM_CAMERAS = ("realitycapture", "xmp")  # with one focal length, relative to the photo's size


def images_of(scene, seed=1):
    """Returns poses in all directions, and one each that looks along the horizon and straight down."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(len(scene.names), random_state=seed).as_matrix()
    rotations[0] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    rotations[1] = np.diag([1.0, -1.0, -1.0])
    images = []
    for index, (name, rotation) in enumerate(zip(scene.names, rotations, strict=True)):
        pose = Pose.from_centre(rotation, rng.uniform(-10, 10, 3) + scene.shift)
        images.append(Image(name, 1 + index % len(scene.cameras), pose, 10 + index))
    return images


def write_results(folder, scene=Scene(), statuses=None):
    """Writes the results of a run, and photos; returns the localized images by name. `statuses`: of further photos."""
    images = images_of(scene)
    cameras = dict(enumerate(scene.cameras, start=1)) | {99: PINHOLE}
    database = [Image("database/1.jpg", 99, Pose.from_centre(np.eye(3), np.array(scene.shift)), 1)]
    write_model(folder / "model", cameras, [*database, *images], binary=True)
    if scene.origin is not None:
        scene.origin.write(folder / "model")
    lines = [result(image.name, "LOCALIZED", image.pose) for image in images]
    lines += [result(name, status, None) for name, status in (statuses or {}).items()]
    (folder / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    for image in images:
        path = folder / "photos" / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        camera = cameras[image.camera_id]
        PIL.Image.new("L", (camera.width, camera.height)).save(path)
    return {image.name: (cameras[image.camera_id], image.pose) for image in images}


def result(name, status, pose):
    fields = None if pose is None else {"qvec": pose.qvec.tolist(), "tvec": pose.tvec.tolist()}
    covariance = None if pose is None else covariance_of(name).tolist()
    return {"name": name, "status": status, "cam_from_world": fields, "pose_covariance_in_map": covariance}


def covariance_of(name):
    """Returns a 6x6 covariance of its own for each name."""
    root = np.random.default_rng(list(name.encode())).normal(size=(6, 6))
    return root @ root.T


def output_of(folder, form):
    return folder / f"out_{form}{'.gpkg' if form == 'gpkg' else ''}"  # GDAL warns of other endings


def export(folder, form, *options):
    """Exports the results in a folder; returns the path of the output, and the exit code."""
    output = output_of(folder, form)
    return output, tool.main(["export", str(folder), "--format", form, "--output", str(output), *map(str, options)])


def crs_of(form, scene):
    """Returns the reference system in which RealityCapture gets a geographic scene."""
    if form != "realitycapture" or scene.origin is None:
        return None
    return "EPSG:32632" if scene.origin == ZURICH else "EPSG:32719"


def options_of(form, scene):
    return [] if crs_of(form, scene) is None else ["--crs", crs_of(form, scene)]


def is_written(form, name):
    return form not in EARTH or name in GEOGRAPHIC


PAIRS = [(form, name) for form in written_formats() for name in SCENES if is_written(form, name)]


@pytest.mark.parametrize(("form", "name"), [pair for pair in PAIRS if pair[0] not in EXPORTS])
def test_exported_poses_are_imported_again(form, name, tmp_path):
    scene = SCENES[name]
    truth = write_results(tmp_path, scene)
    path, code = export(tmp_path, form, *options_of(form, scene))
    assert code == 0
    assert find_format(path) == form
    if form in ("tum", "kitti") and name == "rig":
        return  # of one camera alone; see test_trajectory_of_a_rig...
    is_geographic = form in ("colmap", "metashape", "opensfm", *EARTH) or crs_of(form, scene) is not None
    camera = None if form not in NO_CAMERAS and (form not in FILM_CAMERAS or name == "geographic") else PINHOLE
    origin = scene.origin if is_geographic else None
    posed = read_posed_images(Source(path, Photos(tmp_path / "photos"), camera, crs=crs_of(form, scene), origin=origin))
    assert posed.origin == origin
    images = {image.name: image for image in posed.images}
    assert set(images) == set(truth)
    tolerance = 1e-6 if origin is not None and form not in ("colmap", "opensfm") else 1e-8
    for photo, (camera, pose) in truth.items():
        found = images[photo].cam_from_world
        assert np.linalg.norm(found.cam_in_world - pose.cam_in_world) < tolerance
        assert np.abs(found.rotation - pose.rotation).max() < 1e-9
        if form == "colmap":
            assert images[photo].camera == camera and found.bits() == pose.bits()
        elif form not in NO_CAMERAS and (form not in FILM_CAMERAS or name == "geographic"):
            assert_same_camera(images[photo].camera, camera)


def assert_same_camera(found, camera):
    (kind, values), (true_kind, true_values) = coefficients(found), coefficients(camera)
    assert (kind, found.width, found.height) == (true_kind, camera.width, camera.height)
    assert values == pytest.approx(true_values, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("form", FILM_CAMERAS)
def test_intrinsics_of_realitycapture_are_those_that_it_can_hold(form, tmp_path, capfd):
    """Film 36 mm wide; a camera with two focal lengths has no intrinsics."""
    truth = write_results(tmp_path, Scene((SIMPLE, PINHOLE, FISHEYE)))
    path, code = export(tmp_path, form)
    assert code == 0
    line = "intrinsics of 3 of 5 photos left out, because the format cannot hold their cameras: OPENCV_FISHEYE, PINHOLE"
    assert line in capfd.readouterr().err
    given = {image.name: image.camera for image in read_posed_images(Source(path, Photos(tmp_path / "photos"))).images}
    assert set(given) == {name for name, (camera, _) in truth.items() if camera == SIMPLE}
    for camera in given.values():
        assert_same_camera(camera, SIMPLE)


# Readers without any code of the project. Each returns by name world_from_cam with the axes right, down, forward, and
# the centre; of a geographic format in the local frame at the origin.

OPENGL = np.diag([1.0, -1.0, -1.0])
FORWARD_LEFT_UP = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # rows: forward, left, up in right, down, forward


def read_colmap(path, scene):
    found = {}
    for image in pycolmap.Reconstruction(str(path)).images.values():
        pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
        rotation = pose.rotation.matrix().T
        found[image.name] = rotation, -rotation @ pose.translation
    return found


def read_transforms(path, scene):
    """As nerfstudio: camera_to_worlds with the axes of OpenGL."""
    frames = {
        frame["file_path"]: np.array(frame["transform_matrix"]) for frame in json.loads(path.read_text())["frames"]
    }
    return {name: (matrix[:3, :3] @ OPENGL, matrix[:3, 3]) for name, matrix in frames.items()}


def read_opensfm(path, scene):
    (part,) = json.loads(path.read_text())
    if scene.origin is not None:
        place = part["reference_lla"]
        assert GeoOrigin(place["latitude"], place["longitude"], place["altitude"]) == scene.origin
    found = {}
    for name, shot in part["shots"].items():
        rotation = cv2.Rodrigues(np.array(shot["rotation"]))[0]
        found[name] = rotation.T, -rotation.T @ shot["translation"]
    return found


def read_metashape(path, scene):
    """As Metashape: a camera's transform, then the chunk's, which leads to ECEF."""
    chunk = ET.parse(path).getroot().find("chunk")
    found, names = {}, {pathlib.PurePath(name).stem: name for name in scene.names}
    if scene.names[0].count("/") == 2:
        names = {name.removesuffix(".jpg"): name for name in scene.names}
    for camera in chunk.iter("camera"):
        matrix = np.array(camera.findtext("transform").split(), float).reshape(4, 4)
        name = names.get(camera.get("label"), camera.get("label"))
        found[name] = matrix[:3, :3], matrix[:3, 3]
    if scene.origin is None:
        assert chunk.find("transform") is None
        return found
    assert pyproj.CRS.from_wkt(chunk.findtext("reference")).to_epsg() == 4326
    rotation = np.array(chunk.findtext("transform/rotation").split(), float).reshape(3, 3)
    shift = np.array(chunk.findtext("transform/translation").split(), float)
    to_geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    return {
        name: from_place(scene, to_geodetic.transform(*(rotation @ centre + shift)), rotation @ turn, is_ecef=True)
        for name, (turn, centre) in found.items()
    }


def read_realitycapture(path, scene):
    """Heading, pitch and roll are turns about z (clockwise), x and y of a camera that looks down, its top north."""
    rows = list(csv.reader(path.open()))
    names = {pathlib.PurePath(name).name: name for name in scene.names}
    found = {}
    for name, *cells in rows[1:]:
        heading, pitch, roll = map(float, cells[3:6])
        rotation = Rotation.from_euler("ZXY", [-heading, pitch, roll], degrees=True).as_matrix() @ OPENGL
        found[names.get(name, name)] = rotation, np.array(cells[:3], float)
    return found


def read_xmp(path, scene):
    """As RealityCapture's "XMP Camera Math": x = R (X - position), with the rows of R one after the other."""
    rdf, xcr = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}", "{http://www.capturingreality.com/ns/xcr/1.1#}"
    found = {}
    for name in scene.names:
        root = ET.parse(path / f"{pathlib.PurePath(name).with_suffix('.xmp')}").getroot()
        assert root.tag == "{adobe:ns:meta/}xmpmeta"
        (about,) = root.findall(f"{rdf}RDF/{rdf}Description")
        assert about.get(f"{xcr}PosePrior") == "initial" and about.get(f"{xcr}Coordinates") == "absolute"
        rotation = np.array(about.findtext(f"{xcr}Rotation").split(), float).reshape(3, 3)
        found[name] = rotation.T, np.array(about.findtext(f"{xcr}Position").split(), float)
    return found


def read_tum(path, scene):
    rows = np.loadtxt(path)
    times = [float(name[-10:-4]) if scene.names == SEQUENCE else i for i, name in enumerate(sorted(scene.names))]
    assert rows[:, 0].tolist() == times
    return {name: (Rotation.from_quat(row[4:]).as_matrix(), row[1:4]) for name, row in zip(sorted(scene.names), rows)}


def read_kitti(path, scene):
    matrices = np.loadtxt(path).reshape(-1, 3, 4)
    return {name: (matrix[:, :3], matrix[:, 3]) for name, matrix in zip(sorted(scene.names), matrices, strict=True)}


def read_odm_geo(path, scene):
    """As OpenDroneMap reads the lines, and OpenSfM the angles."""
    header, *lines = path.read_text().splitlines()
    names = {pathlib.PurePath(name).name: name for name in scene.names}
    found = {}
    for line in lines:
        name, *numbers = line.split()
        place, angles = np.array(numbers[:3], float), np.radians(np.array(numbers[3:6], float))
        turns = [cv2.Rodrigues(-angle * axis)[0] for angle, axis in zip(angles, np.eye(3))]
        to_camera = OPENGL @ turns[2] @ turns[1] @ turns[0]
        assert header == "EPSG:4326"
        found[names[name]] = from_place(scene, place, to_camera.T)
    return found


def read_geopose(path, scene):
    """The rotation is that of the body's axes forward, left, up in east, north, up."""
    found = {}
    for name in scene.names:
        values = json.loads((path / f"{name}.json").read_text())
        if "angles" in values:
            assert set(values) == {"position", "angles"}
            angles = [values["angles"][key] for key in ("yaw", "pitch", "roll")]
            rotation = Rotation.from_euler("ZYX", angles, degrees=True)
        else:
            assert set(values) == {"position", "quaternion"}
            rotation = Rotation.from_quat([values["quaternion"][key] for key in "xyzw"])
        place = [values["position"][key] for key in ("lon", "lat", "h")]
        found[name] = from_place(scene, place, rotation.as_matrix() @ FORWARD_LEFT_UP)
    return found


KML = "{http://www.opengis.net/kml/2.2}"


def points_of_kml(path):
    """Returns the values of the points by name; checks the file by OGC's schema of KML 2.2, which fastkml contains."""
    assert fastkml.validator.validate(file_to_validate=path)
    root = ET.parse(path).getroot()
    (document,) = root
    assert (root.tag, document.tag) == (f"{KML}kml", f"{KML}Document")
    name, *placemarks = document
    assert name.tag == f"{KML}name"
    found = {}
    for placemark in placemarks:
        assert placemark.tag == f"{KML}Placemark"
        data = placemark.findall(f"{KML}ExtendedData/{KML}Data")
        values = {item.get("name"): item.findtext(f"{KML}value") for item in data}
        assert placemark.findtext(f"{KML}Style/{KML}IconStyle/{KML}heading") == values["heading_deg"]
        longitude, latitude = map(float, placemark.findtext(f"{KML}Point/{KML}coordinates").split(","))
        assert placemark.find(f"{KML}Point/{KML}altitudeMode") is None  # clampToGround
        place = longitude, latitude, float(values["height_m"])
        found[placemark.findtext(f"{KML}name")] = place, values
    return found


def points_of_geopackage(path):
    """Returns the places and the values of the points by name, by GDAL, which QGIS reads files with."""
    meta, _, geometries, columns = pyogrio.raw.read(path, layer="positions")
    assert (meta["crs"], meta["geometry_type"]) == ("EPSG:4326", "Point Z")
    rows = zip(*columns, strict=True)
    named = [dict(zip(meta["fields"], row, strict=True)) for row in rows]
    places = [struct.unpack("<BI3d", geometry)[2:] for geometry in geometries]  # well-known binary
    return {values.pop("name"): (place, values) for place, values in zip(places, named, strict=True)}


def read_points(path, scene):
    """Heading clockwise from north, then pitch upwards, then roll to the right, of a camera right, forward, up."""
    found = {}
    points = points_of_kml if path.suffix != ".gpkg" else points_of_geopackage
    for name, (place, values) in points(path).items():
        heading, pitch, roll = (float(values[f"{angle}_deg"]) for angle in ("heading", "pitch", "roll"))
        turn = Rotation.from_euler("ZXY", [-heading, pitch, roll], degrees=True).as_matrix()
        found[name] = from_place(scene, place, turn @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    return found


def from_place(scene, place, rotation, is_ecef=False):
    """Returns a rotation in east, north, up at a longitude, latitude and height, and the place, in the local frame."""
    origin = scene.origin
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)

    def axes(longitude, latitude):
        """Columns: east, north, up in ECEF."""
        turn = Rotation.from_euler("ZX", [90 + longitude, 90 - latitude], degrees=True)
        return turn.as_matrix()

    local = axes(origin.longitude_deg, origin.latitude_deg)
    zero = np.array(to_ecef.transform(origin.longitude_deg, origin.latitude_deg, origin.height_m))
    in_ecef = rotation if is_ecef else axes(place[0], place[1]) @ rotation
    return local.T @ in_ecef, local.T @ (np.array(to_ecef.transform(*place)) - zero)


def read_ros2(path, scene):
    """By rosbags: the poses in the map, whose covariances and transforms must belong to them."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    found, transforms, poses = {}, {}, {}
    names = sorted(scene.names)
    times = [int(name[-10:-4]) if scene.names == SEQUENCE else i for i, name in enumerate(names)]
    name_of = dict(zip(times, names, strict=True))
    with Reader(path) as bag:
        for connection, time, data in bag.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            if connection.topic == "/tf":
                (message,) = message.transforms
                at, frame = message.transform, message.child_frame_id
                transforms[time] = (
                    [getattr(at.translation, a) for a in "xyz"],
                    [getattr(at.rotation, a) for a in "xyzw"],
                )
                assert frame == "camera_optical_frame"
            stamp = message.header.stamp
            assert (stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id) == (time, "map")
            if connection.topic == "/localized_pose":
                assert connection.msgtype == "geometry_msgs/msg/PoseWithCovarianceStamped"
                name, pose = name_of[time // 10**9], message.pose.pose
                poses[time] = [getattr(pose.position, a) for a in "xyz"], [getattr(pose.orientation, a) for a in "xyzw"]
                found[name] = Rotation.from_quat(poses[time][1]).as_matrix(), np.array(poses[time][0])
                assert np.array_equal(message.pose.covariance.reshape(6, 6), covariance_of(name))
    assert transforms == poses and set(poses) == {time * 10**9 for time in times}
    return found


READERS = {
    "colmap": read_colmap,
    "transforms": read_transforms,
    "opensfm": read_opensfm,
    "metashape": read_metashape,
    "realitycapture": read_realitycapture,
    "xmp": read_xmp,
    "tum": read_tum,
    "kitti": read_kitti,
    "odmgeo": read_odm_geo,
    "geopose": read_geopose,
    "geoposeypr": read_geopose,
    "gpkg": read_points,
    "kml": read_points,
    "ros2": read_ros2,
}


@pytest.mark.parametrize(("form", "name"), PAIRS)
def test_other_readers_find_the_poses(form, name, tmp_path):
    truth = write_results(tmp_path, SCENES[name])
    path, code = export(tmp_path, form)
    assert code == 0
    found = READERS[form](path, SCENES[name])
    assert set(found) == set(truth)
    for photo, (_, pose) in truth.items():
        rotation, centre = found[photo]
        assert np.abs(rotation - pose.rotation.T).max() < 1e-8
        assert np.linalg.norm(centre - pose.cam_in_world) < 1e-6


@pytest.mark.parametrize(
    ("form", "north", "down"),
    [
        ("geoposeypr", [90, 0, 0], [0, 90, -90]),  # at 0 the front is east
        ("odmgeo", [90, 0, 0], [0, 0, 0]),
        ("realitycapture", [0, 90, 0], [0, 0, 0]),
    ],
)
def test_angles_of_simple_cameras(form, north, down, tmp_path):
    """An upright camera that looks north along the horizon, and one that looks down with its top north, in degrees."""
    scene = SCENES["geographic"]
    write_results(tmp_path, scene)
    path, _ = export(tmp_path, form)
    if form == "geoposeypr":
        files = [path / f"{name}.json" for name in scene.names[:2]]
        found = [list(json.loads(file.read_text())["angles"].values()) for file in files]
    else:
        lines = path.read_text().replace(",", " ").splitlines()[1:3]
        found = [[float(word) for word in line.split()[4:7]] for line in lines]
    rotations = [rotation_of(form, angles) for angles in (*found, north, down)]
    # North at the camera is not quite that at the origin.
    assert np.abs(rotations[0] - rotations[2]).max() < 1e-4
    assert np.abs(rotations[1] - rotations[3]).max() < 1e-4


def rotation_of(form, angles):
    """Returns the rotation of a form's angles, because different ones may mean the same."""
    axes = {"geoposeypr": "ZYX", "odmgeo": "XYZ", "realitycapture": "ZXY"}[form]
    return Rotation.from_euler(axes, angles, degrees=True).as_matrix()


@pytest.mark.parametrize(("crs", "is_outside"), [("EPSG:25832", False), ("EPSG:25833", True)])
def test_export_outside_of_the_area_of_use_is_a_warning(tmp_path, crs, is_outside, capsys):
    write_results(tmp_path, SCENES["geographic"])
    _, code = export(tmp_path, "realitycapture", "--crs", crs)
    count = capsys.readouterr().err.count("outside of its area of use")
    assert (code, count) == (0, int(is_outside))


def test_realitycapture_in_a_grid_has_headings_from_true_north(tmp_path):
    """The camera of the first photo looks north along the horizon, upright."""
    write_results(tmp_path, SCENES["geographic"])
    path, code = export(tmp_path, "realitycapture", "--crs", "EPSG:32632")
    assert code == 0
    rows = list(csv.DictReader(path.open()))
    centre = images_of(SCENES["geographic"])[0].pose.cam_in_world
    _, place = from_place_inverse(ZURICH, centre)
    expected = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:32632", always_xy=True).transform(*place)
    assert [float(rows[0][key]) for key in ("x", "y", "alt")] == pytest.approx(expected, abs=1e-6)
    angles = [float(rows[0][key]) for key in ("heading", "pitch", "roll")]
    turn = Rotation.from_euler("ZXY", [-angles[0], angles[1], angles[2]], degrees=True).as_matrix() @ OPENGL
    assert np.abs(turn @ [0, 0, 1] - [0, 1, 0]).max() < 1e-5  # forward is north, up to the convergence of meridians


def from_place_inverse(origin, centre):
    """Returns the ECEF coordinates of a point of the local frame, and its longitude, latitude and height."""
    turn = Rotation.from_euler("ZX", [90 + origin.longitude_deg, 90 - origin.latitude_deg], degrees=True).as_matrix()
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    point = turn @ centre + to_ecef.transform(origin.longitude_deg, origin.latitude_deg, origin.height_m)
    return point, to_ecef.transform(*point, direction="INVERSE")


@pytest.mark.parametrize("is_training", [True, False])
def test_transforms_are_in_the_frame_of_nerfstudio(is_training, tmp_path):
    """x -> scale (R x + t) of the training, or of the data's own transforms.json; import keeps it."""
    truth = write_results(tmp_path)
    turn = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    shift, scale = np.array([1.0, -2.0, 3.0]), 0.25
    names = ("transform", "scale") if is_training else ("applied_transform", "applied_scale")
    content = dict(zip(names, (np.column_stack([turn, shift]).tolist(), scale)))
    frame = tmp_path / "frame.json"
    frame.write_text(json.dumps({**content, "frames": []}))
    path, code = export(tmp_path, "transforms", "--transforms", frame)
    assert code == 0
    for name, (rotation, centre) in read_transforms(path, Scene()).items():
        pose = truth[name][1]
        assert np.allclose(rotation, turn @ pose.rotation.T, atol=1e-12)
        assert np.allclose(centre, scale * (turn @ pose.cam_in_world + shift), atol=1e-12)
    for image in read_posed_images(Source(path)).images:
        pose = truth[image.name][1]
        centre = scale * (turn @ pose.cam_in_world + shift)
        assert np.allclose(image.cam_from_world.cam_in_world, centre, atol=1e-9)
        assert np.allclose(image.cam_from_world.rotation, pose.rotation @ turn.T, atol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"frames": []}, "has neither a transform"),
        ({"transform": np.diag([1.0, 1, -1, 1]).tolist(), "scale": 1.0}, "a matrix is not a rotation"),
        ({"transform": np.eye(4).tolist(), "scale": 0.0}, "not positive"),
        ({"transform": [1, 2, 3]}, "not those of a 3 x 4"),
    ],
)
def test_bad_frame_of_nerfstudio_is_one_line(content, message, tmp_path, capfd):
    write_results(tmp_path)
    (tmp_path / "frame.json").write_text(json.dumps(content))
    path, code = export(tmp_path, "transforms", "--transforms", tmp_path / "frame.json")
    (line,) = capfd.readouterr().err.splitlines()
    assert code == 1 and "frame.json" in line and message in line and not path.exists()


def test_what_is_left_out_is_named(tmp_path, capfd):
    statuses = {"query/x.jpg": "NO_PAIRS", "query/y.jpg": "LOW_CONFIDENCE", "query/z.jpg": "NO_PAIRS"}
    truth = write_results(tmp_path, SCENES["geographic"], statuses)
    path, code = export(tmp_path, "kitti")
    printed = capfd.readouterr()
    assert code == 0 and printed.out == f"{path}: 5 poses\n"
    assert printed.err.splitlines() == [
        "lazyloc export: 3 of 8 photos left out, because they are not localized: 2 NO_PAIRS, 1 LOW_CONFIDENCE",
        "lazyloc export: kitti has no place for: names, times, intrinsics, the place on the Earth (geo.json), "
        "covariances",
    ]
    assert len(path.read_text().splitlines()) == len(truth)


def test_database_images_are_an_option(tmp_path):
    truth = write_results(tmp_path)
    path, _ = export(tmp_path, "colmap")
    assert set(read_model(path).images) == set(truth)
    path, code = export(tmp_path, "colmap", "--with_database", "--overwrite")
    assert code == 0 and set(read_model(path).images) == {*truth, "database/1.jpg"}


def test_folder_of_lazyloc_run_is_one_of_results(tmp_path):
    write_results(tmp_path / "localized")
    path, code = export(tmp_path, "tum")
    assert code == 0 and len(np.loadtxt(path)) == len(SEQUENCE)


@pytest.mark.parametrize("form", [*EARTH, "realitycapture"])
def test_geographic_format_needs_a_place_on_the_earth(form, tmp_path, capfd):
    write_results(tmp_path)
    path, code = export(tmp_path, form, *(["--crs", "EPSG:32632"] if form == "realitycapture" else []))
    assert code == 1 and not path.exists()
    (line,) = capfd.readouterr().err.splitlines()
    assert "geo.json" in line


@pytest.mark.parametrize("form", written_formats())
def test_existing_output_is_kept_unless_overwritten(form, tmp_path, capfd):
    write_results(tmp_path, SCENES["geographic"])
    path, code = export(tmp_path, form)
    before = contents(path)
    assert code == 0
    assert export(tmp_path, form)[1] == 1
    assert "exists; --overwrite replaces it" in capfd.readouterr().err and contents(path) == before
    assert export(tmp_path, form, "--overwrite", "0")[1] == 1
    for words in (["--overwrite", "1"], ["--overwrite"], ["--overwrite=1"]):
        assert export(tmp_path, form, *words)[1] == 0
    assert contents(path) == before
    assert not [other for other in tmp_path.iterdir() if other.name.startswith(".")]


def test_results_may_follow_the_option_overwrite(tmp_path):
    write_results(tmp_path)
    path, _ = export(tmp_path, "tum")
    path.write_text("old\n")
    assert tool.main(["export", "--format", "tum", "--output", str(path), "--overwrite", str(tmp_path)]) == 0
    assert path.read_text() != "old\n"


def contents(path):
    return {file.relative_to(path): file.read_bytes() for file in [path, *path.rglob("*")] if file.is_file()}


def test_folder_with_other_files_is_never_replaced(tmp_path, capfd):
    write_results(tmp_path, SCENES["geographic"])
    for form in written_formats():
        path = output_of(tmp_path, form)
        path.mkdir()
        (path / "holiday.jpg").touch()
        assert export(tmp_path, form, "--overwrite")[1] == 1
        assert (path / "holiday.jpg").exists() and "would be replaced" in capfd.readouterr().err
    words = ["export", str(tmp_path), "--format", "colmap", "--overwrite", "--output", str(tmp_path / "model")]
    assert tool.main(words) == 1
    assert "is the model of the results" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("form", "options", "message"),
    [
        ("kitti", ["--crs", "EPSG:32632"], "--crs EPSG:32632: has no effect"),
        ("realitycapture", ["--crs", "EPSG:99999"], "--crs EPSG:99999"),
        ("tum", ["--transforms", "frame.json"], "--transforms frame.json: has no effect"),
        ("gltf", [], "invalid choice"),
    ],
)
def test_bad_options_are_one_line(form, options, message, tmp_path, capfd):
    write_results(tmp_path, SCENES["geographic"])
    path, code = export(tmp_path, form, *options)
    assert code == 1 and not path.exists()
    assert message in capfd.readouterr().err.splitlines()[-1]


def test_results_without_a_pose_are_one_line(tmp_path, capfd):
    write_results(tmp_path, Scene(names=("1.jpg", "2.jpg")))
    lines = [result(name, "NO_PAIRS", None) for name in ("1.jpg", "2.jpg")]
    (tmp_path / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    path, code = export(tmp_path, "tum")
    assert code == 1 and not path.exists()
    assert capfd.readouterr().err.splitlines()[-1].endswith("results.jsonl: no photo is localized")


@pytest.mark.parametrize("form", written_formats())
def test_names_are_read_again_or_left_out(form, tmp_path, capfd):
    """Blanks, quotes and characters of XML; a line break is left out where names are written."""
    names = ("a b.jpg", 'it\'s "c", <d> & é.jpg', "f/g.jpg", "line\nbreak.jpg")
    scene = Scene(names=names, origin=ZURICH)
    write_results(tmp_path, scene)
    path, code = export(tmp_path, form)
    assert code == 0
    if form in ("tum", "kitti"):
        assert len(np.loadtxt(path)) == len(names)
        return
    if form == "ros2":
        with Reader(path) as bag:
            assert bag.message_count == 2 * len(names)
        return
    expected = {"f/g.jpg"} if form == "odmgeo" else set(names[:3])
    assert f"{4 - len(expected)} of 4 photos left out" in capfd.readouterr().err
    if form in ("gpkg", "kml"):
        assert set((points_of_kml if form == "kml" else points_of_geopackage)(path)) == expected
        return
    posed = read_posed_images(Source(path, Photos(tmp_path / "photos"), PINHOLE))
    assert {image.name for image in posed.images} == expected


def test_camera_that_a_format_lacks_is_left_out(tmp_path, capfd):
    write_results(tmp_path, Scene((PINHOLE, Camera("FOV", *SIZE, (500.0, 500.0, 320.0, 240.0, 0.9)))))
    path, _ = export(tmp_path, "opensfm")
    assert "2 of 5 photos left out, because the format cannot hold their cameras: FOV" in capfd.readouterr().err
    assert len(read_opensfm(path, Scene())) == 3
    for form in ("transforms", "metashape"):
        path, _ = export(tmp_path, form)
        assert "intrinsics of 2 of 5 photos left out" in capfd.readouterr().err
        assert len(READERS[form](path, Scene())) == 5
        assert len(read_posed_images(Source(path, Photos(tmp_path / "photos"))).images) == 3


def test_transforms_have_shared_intrinsics_once(tmp_path):
    """As instant-ngp needs it; nerfstudio reads the camera model from there only."""
    write_results(tmp_path)
    data = json.loads(export(tmp_path, "transforms")[0].read_text())
    assert (data["fl_x"], data["fl_y"], data["w"], data["camera_model"]) == (500.0, 510.0, WIDTH, "OPENCV")
    assert set(data["frames"][0]) == {"file_path", "transform_matrix"}
    write_results(tmp_path, SCENES["cameras"])
    data = json.loads(export(tmp_path, "transforms", "--overwrite")[0].read_text())
    assert data["camera_model"] == "OPENCV" and "fl_x" not in data
    assert [frame["fl_x"] for frame in data["frames"]] == [500.0, 600.0, 500.0, 700.0, 500.0]


def test_metashape_has_its_own_names_of_coefficients(tmp_path):
    """Metashape's p1 and p2 are exchanged, its cx and cy are from the middle, b1 is the difference of focal lengths."""
    write_results(tmp_path, Scene((OPENCV,)))
    sensor = ET.parse(export(tmp_path, "metashape")[0]).getroot().find("chunk/sensors/sensor")
    values = {child.tag: float(child.text) for child in sensor.find("calibration") if child.text and child.text.strip()}
    assert values == {
        "f": 510.0,
        "b1": -10.0,
        "cx": -10.0,
        "cy": 10.0,
        "k1": -0.1,
        "k2": 0.02,
        "p1": -2e-3,
        "p2": 1e-3,
    }


def test_xmp_has_the_distortion_of_its_model(tmp_path):
    """The numbers of RealityCapture: the longer side of the photo is 1, the focal length that of a film 36 mm wide."""
    camera = Camera("OPENCV", *SIZE, (600.0, 600.0, 330.0, 235.0, -0.1, 0.02, 1e-3, -2e-3))
    write_results(tmp_path, Scene((camera, SIMPLE, Camera("SIMPLE_PINHOLE", *SIZE, (600.0, 320.0, 240.0)))))
    path, _ = export(tmp_path, "xmp")
    found = []
    for name in SEQUENCE[:3]:
        xcr = "{http://www.capturingreality.com/ns/xcr/1.1#}"
        (about,) = (e for e in ET.parse(path / name.replace(".jpg", ".xmp")).iter() if e.get(f"{xcr}Version"))
        keys = ("FocalLength35mm", "PrincipalPointU", "PrincipalPointV")
        numbers = [float(about.get(xcr + key)) for key in keys]
        numbers += map(float, about.findtext(f"{xcr}DistortionCoeficients").split())
        found.append((about.get(f"{xcr}DistortionModel"), pytest.approx(numbers)))
    middle = [10 / 640, -5 / 640]
    assert found == [
        ("brown3t2", [33.75, *middle, -0.1, 0.02, 0, 0, -2e-3, 1e-3]),
        ("brown3", [33.75, *middle, -0.05, 0, 0, 0, 0, 0]),
        ("perspective", [33.75, 0, 0, 0, 0, 0, 0, 0, 0]),
    ]


def test_two_photos_of_one_xmp_file_are_one_line(tmp_path, capfd):
    write_results(tmp_path, Scene((SIMPLE,), ("a/1.jpg", "a/1.png")))
    path, code = export(tmp_path, "xmp")
    (line,) = capfd.readouterr().err.splitlines()
    assert code == 1 and not path.exists()
    assert "a/1.xmp: would belong to 'a/1.png' and 'a/1.jpg'" in line


def test_kml_has_status_accuracy_and_angles(tmp_path):
    """Of a camera that looks along the horizon to the north-east, its right side lower by 10 degrees."""
    scene = SCENES["geographic"]
    write_results(tmp_path, scene)
    level = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    rotation = Rotation.from_euler("ZY", [-45, 10], degrees=True).as_matrix() @ level
    pose = Pose.from_centre(rotation.T, np.array([1.0, 2.0, 3.0]))
    images = [Image("q.jpg", 1, pose, 1), Image("d.jpg", 2, pose, 2)]
    write_model(tmp_path / "model", {1: SIMPLE, 2: PINHOLE}, images, binary=True)
    more = {"position_covariance": np.diag([0.01, 0.04, 0.09]).tolist(), "confidence": 0.75, "heading_stddev_deg": 0.5}
    (tmp_path / "results.jsonl").write_text(json.dumps(result("q.jpg", "LOCALIZED", pose) | more) + "\n")
    path, code = export(tmp_path, "kml", "--with_database")
    points = points_of_kml(path)
    assert code == 0 and set(points) == {"q.jpg", "d.jpg"}
    values = points["q.jpg"][1]
    assert values.pop("status") == "LOCALIZED" and points["d.jpg"][1]["status"] == "DATABASE"
    expected = {"confidence": 0.75, "stddev_east_m": 0.1, "stddev_north_m": 0.2, "stddev_up_m": 0.3}
    expected |= {"heading_deg": 45, "pitch_deg": 0, "roll_deg": 10, "heading_stddev_deg": 0.5, "height_m": 411}
    assert {name: float(value) for name, value in values.items()} == pytest.approx(expected, abs=1e-4)
    assert "confidence" not in points["d.jpg"][1]


@pytest.mark.parametrize(
    ("names", "stamps"),
    [
        (("cam/1.5.jpg", "cam/10.25.jpg"), [1_500_000_000, 10_250_000_000]),  # seconds
        (("1403636579763.png", "1403636579813.png"), [1403636579763_000_000, 1403636579813_000_000]),
        (("1403636579763555584.png", "1403636579813555456.png"), [1403636579763555584, 1403636579813555456]),
        (("a.png", "b.png"), [0, 10**9]),
    ],
)
def test_stamps_of_a_bag_are_the_times_in_names(names, stamps, tmp_path):
    write_results(tmp_path, Scene(names=names))
    path, code = export(tmp_path, "ros2")
    assert code == 0 and sorted(file.name for file in path.iterdir()) == ["localized.db3", "metadata.yaml"]
    with Reader(path) as bag:
        times = [time for connection, time, _ in bag.messages() if connection.topic == "/tf"]
    assert times == stamps


def test_bag_needs_covariances_and_times(tmp_path, capfd):
    write_results(tmp_path, Scene(names=("1.jpg", "99999999999999999999.jpg")))
    path, code = export(tmp_path, "ros2")
    assert code == 1 and not path.exists()
    assert "photo '99999999999999999999.jpg': its number is no time" in capfd.readouterr().err
    write_results(tmp_path)
    lines = [json.loads(line) for line in (tmp_path / "results.jsonl").read_text().splitlines()]
    lines[0]["pose_covariance_in_map"] = None
    (tmp_path / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    path, code = export(tmp_path, "ros2", "--with_database")
    printed = capfd.readouterr()
    assert code == 0 and printed.out == f"{path}: 4 poses\n"
    assert "2 of 6 photos left out, because their covariances are not known" in printed.err


def test_trajectory_of_a_rig_says_that_times_are_numbers(tmp_path, capfd):
    write_results(tmp_path, SCENES["rig"])
    path, code = export(tmp_path, "tum")
    assert code == 0 and "times are 0, 1, 2, ..." in capfd.readouterr().err
    assert np.loadtxt(path)[:, 0].tolist() == list(range(6))


def test_geopackage_has_positions_and_fields_of_view(tmp_path):
    """As a GIS reads it: two layers with the same values, polygons only of the photos whose view is known."""
    truth = write_results(tmp_path, SCENES["geographic"])
    ring = [[8.5, 47.3], [8.6, 47.3], [8.55, 47.4], [8.5, 47.3]]
    feature = {
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "properties": {"name": SEQUENCE[1], "shows": "field_of_view"},
    }
    (tmp_path / "positions.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    path, code = export(tmp_path, "gpkg", "--with_database")
    assert code == 0
    assert pyogrio.list_layers(path).tolist() == [["positions", "Point Z"], ["fields_of_view", "Polygon"]]
    points = points_of_geopackage(path)
    assert set(points) == {*truth, "database/1.jpg"}
    assert points["database/1.jpg"][1]["status"] == "DATABASE" and points[SEQUENCE[1]][1]["status"] == "LOCALIZED"
    meta, _, (polygon,), columns = pyogrio.raw.read(path, layer="fields_of_view")
    assert struct.unpack("<BIII8d", polygon)[4:] == tuple(number for point in ring for number in point)
    values = dict(zip(meta["fields"], (column[0] for column in columns), strict=True))
    assert values.pop("name") == SEQUENCE[1]
    assert {k: v for k, v in values.items() if v == v} == {k: v for k, v in points[SEQUENCE[1]][1].items() if v == v}
    assert pyogrio.read_info(path, layer="fields_of_view")["total_bounds"] == (8.5, 47.3, 8.6, 47.4)


def test_damaged_fields_of_view_are_one_line(tmp_path, capfd):
    write_results(tmp_path, SCENES["geographic"])
    (tmp_path / "positions.geojson").write_text('{"type":"FeatureCollection","features":[')
    path, code = export(tmp_path, "gpkg")
    assert code == 1 and not path.exists()
    assert "positions.geojson: is damaged or cut off" in capfd.readouterr().err

"""The formats by name: each is one row, for reading and for writing. Options, help and the table in docs/own_data.md
follow from these rows."""

import dataclasses
import functools
import pathlib
import re
from collections.abc import Callable

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import is_model
from colmap_lazyloc.pose_formats import (
    blocks_exchange,
    bundler,
    colmap,
    datasets,
    geopackage,
    geopose,
    json_lists,
    kml,
    metashape,
    odm_geo,
    opensfm,
    positions,
    ros2,
    table,
    trajectories,
    transforms_json,
    xmp,
)
from colmap_lazyloc.pose_formats.assembly import assemble
from colmap_lazyloc.pose_formats.conventions import COLMAP, Convention
from colmap_lazyloc.pose_formats.posed_images import PosedImages, Source
from colmap_lazyloc.pose_formats.raw_poses import RawPoses, errors_named
from colmap_lazyloc.pose_formats.signatures import Head, foreign
from colmap_lazyloc.pose_formats.writing import NO_TARGET, Target, World, Writer, describe_omitted, file_of, raw_poses

TO_WORLD, FROM_WORLD = "world_from_cam", "cam_from_world"


@dataclasses.dataclass(frozen=True)
class Format:
    """A format: what it is, how its files are known, what their numbers mean, and the functions that read and write
    them.

    `world`, `cameras`, `photos`: where the coordinates are, which intrinsics are read, and how photos are found.
    `is_trajectory`: poses are those of a body, for which a calibration may give the mounting of the camera. `writer`:
    None if the format is only read.
    """

    title: str
    parse: Callable[[Source], RawPoses]
    is_one: Callable[[Head], bool]
    convention: Convention
    world: str = "as in the file"
    cameras: str = "--camera"
    photos: str = "name"
    is_trajectory: bool = False
    writer: Writer | None = None


@dataclasses.dataclass(frozen=True)
class Export:
    """A format that is only written: what it is, what its numbers mean, and how it is written."""

    title: str
    convention: Convention
    writer: Writer


def _trajectory(
    title: str,
    layouts: tuple[str, ...],
    is_one: Callable[[Head], bool],
    convention: Convention,
    photos: str = "time",
    reader: Callable[..., RawPoses] = trajectories.parse,
    writer: Writer | None = None,
) -> Format:
    """Returns the row of a table whose columns have names, or a layout."""
    parse = functools.partial(reader, layouts=layouts, convention=convention)
    cameras = "--camera or --calibration"
    return Format(title, parse, is_one, convention, cameras=cameras, photos=photos, is_trajectory=True, writer=writer)


def _any_name(_: str) -> bool:
    return True


def _is_geopose(head: Head, key: str) -> bool:
    """True for a GeoPose with this object, or for a folder of them."""
    paths = head.path.rglob(f"*{geopose.ENDING}") if head.is_folder else [head.path]
    return any(Head(path).json("position", key) for path in paths)


FORMATS: dict[str, Format] = {
    "colmap": Format(
        "COLMAP: the folder of a model, text or binary",
        colmap.parse,
        lambda f: f.is_model,
        COLMAP,
        "geographic if geo.json is beside the model",
        "all",
        writer=Writer(colmap.write, World.LOCAL, "points, rigs", folder=colmap.FILES),
    ),
    "poses": Format(
        "poses.txt of this program and of hloc: name qw qx qy qz tx ty tz",
        colmap.parse_poses,
        lambda f: _has_names_and(7, f),
        COLMAP,
    ),
    "transforms": Format(
        "transforms.json of nerfstudio, instant-ngp, Polycam, NeRF's synthetic scenes",
        transforms_json.parse,
        lambda f: f.json("frames"),
        Convention(TO_WORLD, "opengl", "matrix"),
        cameras="fl_x, fl_y, cx, cy, w, h, camera_angle_x, k1 to k6, p1, p2, camera_model; once, or for each frame",
        writer=Writer(file_of(transforms_json.text), cameras=transforms_json.HOLDS),
    ),
    "arkit": _trajectory(
        "Tables of ARKit: Polycam's columns t_00 ... t_23, ios_logger, ARKit Data Logger",
        trajectories.ARKIT,
        lambda f: any(word in f.name for word in ("arkit", "arposes")) or f.has("t00|m00"),
        Convention(TO_WORLD, "opengl"),
        "name, or time",
    ),
    "arcore": _trajectory(
        "Tables of ARCore's Camera.getPose()",
        trajectories.ARCORE,
        lambda f: "arcore" in f.name,
        Convention(TO_WORLD, "opengl", quaternion="xyzw"),
        "name, or time",
    ),
    "strayscanner": _trajectory(
        "Stray Scanner: odometry.csv",
        (),
        lambda f: f.has(*trajectories.STRAY_SCANNER),
        Convention(TO_WORLD, quaternion="xyzw"),
        "number of the frame",
    ),
    "euroc": _trajectory(
        "EuRoC: data.csv, ground truth poses of the body; --calibration must give the pose of the camera on the body",
        (),
        lambda f: f.has("prsrx"),
        Convention(TO_WORLD, "body"),
        reader=trajectories.parse_of_body,
    ),
    "metashape": Format(
        "Metashape: Export Cameras, Agisoft XML",
        metashape.parse,
        lambda f: f.xml("<chunk"),
        Convention(TO_WORLD, rotation="matrix"),
        "geographic if the chunk is georeferenced, else local",
        "frame, fisheye, spherical: f, cx, cy, k1 to k4, p1, p2, b1",
        writer=Writer(file_of(metashape.text), World.LOCAL, "folders and extensions in photo names", metashape.HOLDS),
    ),
    "blocksexchange": Format(
        "ContextCapture, iTwin Capture, Metashape: BlocksExchange XML",
        blocks_exchange.parse,
        lambda f: f.xml("<BlocksExchange"),
        blocks_exchange.CONVENTION,
        "local, or in the projected reference system of the block",
        "Perspective: focal length, PrincipalPoint, K1 to K3, P1, P2",
    ),
    "realitycapture": Format(
        "RealityCapture, RealityScan 2: CSV, Internal/External camera parameters or the list with headings",
        table.parse_reality_capture,
        table.is_reality_capture,
        Convention(TO_WORLD, "opengl", "yaw, pitch, roll", vector="centre"),
        "as in the file; with --crs, geographic",
        "f (35 mm film), px, py, k1 to k3, t1, t2; needs --image_path",
        writer=Writer(
            file_of(table.reality_capture_text),
            World.GRID,
            "folders in photo names, image sizes",
            table.REALITY_CAPTURE_HOLDS,
        ),
    ),
    "xmp": Format(
        "RealityCapture, RealityScan: a folder with an XMP file for each photo, or one XMP file",
        xmp.parse,
        xmp.is_one,
        Convention(FROM_WORLD, rotation="matrix", vector="centre"),
        cameras="FocalLength35mm, PrincipalPointU, PrincipalPointV, DistortionCoeficients; needs --image_path",
        writer=Writer(
            xmp.write,
            World.MODEL,
            "extensions in photo names, image sizes",
            table.REALITY_CAPTURE_HOLDS,
            folder=rf".*{re.escape(xmp.ENDING)}",
        ),
    ),
    "pix4d": Format(
        "Pix4D: calibrated_external_camera_parameters.txt",
        table.parse,
        lambda f: f.has("imagename", *table.ANGLES),
        Convention(TO_WORLD, "opengl", "omega, phi, kappa", vector="centre"),
        "as in the file; with --crs, geographic",
    ),
    "opensfm": Format(
        "OpenSfM, OpenDroneMap: reconstruction.json",
        opensfm.parse,
        lambda f: f.starts("[") and f.json("shots|cameras"),
        Convention(FROM_WORLD, rotation="rotation vector"),
        "geographic: a local frame with its origin at reference_lla",
        "perspective, radial, brown, fisheye, spherical",
        writer=Writer(file_of(opensfm.text), World.LOCAL, cameras=opensfm.HOLDS, needs_camera=True),
    ),
    "odmgeo": Format(
        "OpenDroneMap: geo.txt with omega, phi, kappa",
        odm_geo.parse,
        odm_geo.is_one,
        Convention(TO_WORLD, "opengl", "omega, phi, kappa", vector="centre"),
        "geographic, in the reference system that the first line names; angles from true north",
        writer=Writer(
            file_of(odm_geo.text),
            World.EARTH,
            "intrinsics, folders in photo names",
            holds_name=lambda name: name.isprintable() and len(name.split()) == 1,
        ),
    ),
    "odmshots": Format(
        "OpenDroneMap: odm_report/shots.geojson",
        opensfm.parse_shots,
        lambda f: f.json("features", "rotation", "filename"),
        Convention(FROM_WORLD, rotation="rotation vector", vector="centre"),
        "geographic: UTM, in the zone of the photos",
        "from cameras.json; without this file, the focal length from shots.geojson",
    ),
    "bundler": Format(
        "Bundler: bundle.out with list.txt",
        bundler.parse,
        lambda f: f.starts("# Bundle file"),
        Convention(FROM_WORLD, "opengl", "matrix"),
        cameras="focal length, k1, k2",
    ),
    "nvm": Format(
        "VisualSFM: NVM_V3",
        bundler.parse_nvm,
        lambda f: f.starts("NVM_V3"),
        Convention(FROM_WORLD, vector="centre"),
        cameras="from FixedK; in a file without FixedK, focal length and distortion (principal point in the middle)",
    ),
    "cambridge": Format(
        "Cambridge Landmarks: the folder of a scene, or dataset_train.txt",
        bundler.parse_cambridge,
        lambda f: (f.path / bundler.CAMBRIDGE).is_file() if f.is_folder else f.starts("Visual Landmark Dataset"),
        Convention(FROM_WORLD, vector="centre"),
        cameras="from reconstruction.nvm, or --camera",
    ),
    "7scenes": Format(
        "7 Scenes: the folder of a scene; only the sequences in TrainSplit.txt are read",
        datasets.parse_seven_scenes,
        datasets.is_seven_scenes,
        Convention(TO_WORLD, rotation="matrix"),
        cameras="the Kinect's nominal focal length, 525 pixels",
    ),
    "12scenes": Format(
        "12 Scenes: the folder of a scene; the first sequence is left out, because it is for testing",
        datasets.parse_twelve_scenes,
        datasets.is_twelve_scenes,
        Convention(TO_WORLD, rotation="matrix"),
        cameras="from info.txt",
    ),
    "scannet": Format(
        "ScanNet: the folder with the folders color, pose and intrinsic, which ScanNet's SensReader exports",
        datasets.parse_scannet,
        datasets.is_scannet,
        Convention(TO_WORLD, rotation="matrix"),
        cameras="intrinsic/intrinsic_color.txt",
    ),
    "arkitscenes": Format(
        "ARKitScenes: the folder of a video, or lowres_wide.traj",
        datasets.parse_arkit_scenes,
        datasets.is_arkit_scenes,
        Convention(FROM_WORLD, rotation="rotation vector"),
        cameras="the .pincam files in the folders whose names end with _intrinsics",
        photos="time",
    ),
    "record3d": Format(
        "Record3D: metadata.json",
        json_lists.parse_record3d,
        lambda f: f.json("poses", "K"),
        Convention(TO_WORLD, "opengl", quaternion="xyzw"),
        cameras="K, perFrameIntrinsicCoeffs",
        photos="number of the frame",
    ),
    "polycam": Format(
        "Polycam's raw data: the folder keyframes/corrected_cameras",
        json_lists.parse_polycam,
        lambda f: f.is_folder and any(Head(path).json("t_00") for path in f.path.glob("*.json")),
        Convention(TO_WORLD, "opengl", "matrix"),
        cameras="fx, fy, cx, cy, width, height",
    ),
    "splatting": Format(
        "3D Gaussian Splatting: cameras.json",
        json_lists.parse_splatting,
        lambda f: f.json("img_name", "position", "rotation"),
        Convention(TO_WORLD, rotation="matrix", vector="centre"),
        cameras="fx, fy, cx, cy",
    ),
    "rtabmap": _trajectory(
        "RTAB-Map: ..._camera_poses.txt, poses with ids. For a file with poses of the robot, pass --calibration",
        trajectories.RTABMAP,
        lambda f: f.num_numbers == 9,
        Convention(TO_WORLD, quaternion="xyzw"),
        "number (the id), or time",
        trajectories.parse_of_body,
    ),
    "tum": _trajectory(
        "SLAM trajectories in the format of TUM: timestamp tx ty tz qx qy qz qw",
        trajectories.TUM,
        lambda f: (
            (f.num_numbers == 8 and f.columns[:1] != ["name"])
            or (f.has("timestamp|time", "x|tx|px", "qw") and not f.has("|".join(table.NAME)))
        ),
        Convention(TO_WORLD, quaternion="xyzw"),
        "time, or number",
        functools.partial(trajectories.parse, takes_names=False),
        Writer(file_of(trajectories.tum_text), omits="names, intrinsics", holds_name=_any_name),
    ),
    "kitti": _trajectory(
        "KITTI odometry: a 3 x 4 matrix per line",
        trajectories.KITTI,
        lambda f: f.num_numbers == 12,
        Convention(TO_WORLD, rotation="matrix"),
        "order",
        writer=Writer(file_of(trajectories.kitti_text), omits="names, times, intrinsics", holds_name=_any_name),
    ),
    "kitti360": _trajectory(
        "KITTI-360: cam0_to_world.txt, a frame number and a matrix per line; or poses.txt (poses of the body) with "
        "--calibration",
        trajectories.KITTI360,
        lambda f: f.num_numbers in (13, 17) and f.first_row[0].isdecimal(),
        Convention(TO_WORLD, rotation="matrix"),
        "number of the frame",
        trajectories.parse_of_body,
    ),
    **{
        name: Format(
            f"GeoPose 1.0 of OGC, {title}: a file, or a folder with a file for each photo",
            functools.partial(geopose.parse, rotation=rotation),
            functools.partial(_is_geopose, key=rotation[0]),
            convention,
            "geographic",
            writer=Writer(
                functools.partial(geopose.write, rotation=rotation),
                World.EARTH,
                "intrinsics",
                folder=rf".*{re.escape(geopose.ENDING)}",
            ),
        )
        for name, title, rotation, convention in (
            ("geopose", "Basic-Quaternion", geopose.QUATERNION, Convention(TO_WORLD, "body", quaternion="xyzw")),
            (
                "geoposeypr",
                "Basic-YPR",
                geopose.ANGLES,
                Convention(TO_WORLD, "body", "yaw, pitch, roll about z, y, x"),
            ),
        )
    },
    "matrices": Format(
        "4 x 4 matrices: a file with one matrix per line or per four lines (Open3D), or a folder with one matrix per "
        "file",
        trajectories.parse_matrices,
        lambda f: f.has_matrices,
        Convention(TO_WORLD, rotation="matrix"),
        photos="number, or order",
        is_trajectory=True,
    ),
    "csv": Format(
        "A table of your own",
        table.parse,
        lambda f: f.is_table,
        Convention(TO_WORLD, vector="centre"),
        "geographic if the table has latitudes and longitudes, or with --crs; else as in the file",
        "width, height, fx, fy, cx, cy, k1 to k6, p1, p2, camera_model",
    ),
}


EXPORTS: dict[str, Export] = {
    "gpkg": Export(
        "GeoPackage of QGIS, ArcGIS: a layer of positions, with angles and accuracy, and one of fields of view",
        Convention(TO_WORLD, "rfu", "yaw, pitch, roll"),
        Writer(geopackage.write, World.EARTH, "intrinsics"),
    ),
    "kml": Export(
        "KML of Google Earth: a point for each photo, with its status, heading and accuracy",
        Convention(TO_WORLD, "rfu", "yaw, pitch, roll"),
        Writer(file_of(kml.text), World.EARTH, "intrinsics, heights of points (these are on the ground)"),
    ),
    "ros2": Export(
        "A bag of ROS 2 with poses and their covariances, and /tf",
        Convention(TO_WORLD, quaternion="xyzw"),
        Writer(
            ros2.write,
            omits="names, intrinsics",
            holds_name=_any_name,
            folder=ros2.FILES,
            needs_covariances=True,
        ),
    ),
}


def _has_names_and(count: int, head: Head) -> bool:
    """True if the first line is a name and numbers, separated by blanks, and a header does not specify otherwise."""
    words = head.first_data_line.rsplit(maxsplit=count)
    if len(words) != count + 1 or head.count_numbers(words[1:]) != count:
        return False
    if head.columns:
        return colmap.is_header_of_poses_txt(head.columns)
    return head.count_numbers(words[0].split()) == 0


def written_formats() -> dict[str, Export]:
    """Returns the formats that are not only read."""
    both = {name: Export(f.title, f.convention, f.writer) for name, f in FORMATS.items() if f.writer is not None}
    return both | EXPORTS


def write_posed_images(path: pathlib.Path, posed: PosedImages, name: str, target: Target = NO_TARGET) -> int:
    """Writes a file of a format, or a folder, which does not exist; returns the number of its poses.

    A line names what the format cannot hold.
    """
    form = written_formats()[name]
    raw = raw_poses(posed, form.convention, form.writer, target)
    if not raw.poses:
        raise InputError("there is no pose to write")
    form.writer.write(path, raw)
    logger.warning("%s has no place for: %s", name, describe_omitted(posed, form.writer, target))
    return len(raw.poses)


def read_posed_images(source: Source, format_name: str | None = None) -> PosedImages:
    """Reads a file of any format; each error is an InputError that names the file."""
    if not source.path.exists():
        raise InputError(f"{source.path}: does not exist")
    _refuse_empty(source.path)
    form = FORMATS[format_name or find_format(source.path)]
    if source.calibration_path is not None and not form.is_trajectory:
        raise InputError(f"--calibration {source.calibration_path}: is for trajectories; {source.path} has names")
    with errors_named(source.path, f"is no file of the format {form.title}: "):
        raw = form.parse(source)
        return assemble(raw, raw.convention or form.convention, source)


def _refuse_empty(path: pathlib.Path) -> None:
    """Refuses a file without any content, in which no format is at fault."""
    try:
        is_empty = path.is_file() and not Head(path).data.strip()
    except OSError:
        return  # the reader reports why it cannot be read
    if is_empty:
        raise InputError(f"{path}: is empty")


def find_format(path: pathlib.Path) -> str:
    """Returns the name of a file's format by its content."""
    try:
        head = Head(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    *names, last = FORMATS  # the last is found by the little that a table has
    name = next((name for name in names if FORMATS[name].is_one(head)), None)
    if name is not None:
        return name
    if positions.is_one(head):
        raise InputError(f"{path}: {positions.NO_POSES}")
    other = foreign(head)
    if other is not None:
        raise InputError(f"{path}: {other}")
    if FORMATS[last].is_one(head):
        return last
    if path.is_dir():
        inside = next((folder for folder in sorted(path.iterdir()) if is_model(folder)), None)
        hint = f"; give {inside}" if inside else ""
        raise InputError(f"{path}: holds no COLMAP model (no images.bin or images.txt){hint}")
    raise InputError(f"{path}: its format is not known; name it: {', '.join(FORMATS)}")

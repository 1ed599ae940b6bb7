"""Converts camera poses of another program to a COLMAP model without points.

    lazyloc import FORMAT FILE --output_path MODEL --image_path photos

FORMAT is one of the following:

FORMATS

`exif` writes a text file for `colmap lazy_localizer --query_position_path`. `panoramas` writes a folder of images with
rig.json and queries.txt.

Geographic coordinates are converted to a local frame in metres: x east, y north, z up. The file geo.json beside the
model contains the origin of this frame.
"""

import argparse
import dataclasses
import pathlib
import re
import sys
from collections.abc import Callable, Sequence
from typing import Any

from colmap_lazyloc import panoramas
from colmap_lazyloc.agreement.check import add_accept_option, check_photos
from colmap_lazyloc.errors import InputError, Parser, command, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats import exif_gps
from colmap_lazyloc.pose_formats.assembly import some_of
from colmap_lazyloc.pose_formats.colmap import write_posed_images
from colmap_lazyloc.pose_formats.conventions import CAMERA_AXES, DIRECTIONS, QUATERNION_ORDERS
from colmap_lazyloc.pose_formats.geo import FILE_NAME, GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import Photos, PosedImages, Source
from colmap_lazyloc.pose_formats.registry import FORMATS, read_posed_images
from colmap_lazyloc.pose_formats.rigs import Rig

AUTO, EXIF, PANORAMAS = "auto", "exif", "panoramas"
CONVENTION_OPTIONS = ("camera", "calibration", "crs", "pose_direction", "camera_axes", "quaternion_order")
# Options that would have no effect, by what is made; panoramas without poses use none of the options of a source.
UNUSED = {
    EXIF: (*CONVENTION_OPTIONS, "image_path", "rig_config_path", "poses", "binary"),
    PANORAMAS: ("image_path", "rig_config_path", "model"),
    AUTO: ("model", "poses"),
}


def add_source_options(add: Callable[..., Any]) -> None:
    """Adds the options that describe a file of poses; `add`: the function of an argument parser."""
    add(
        "--camera",
        metavar="'MODEL W H PARAMS...'",
        help="intrinsics of all database images, for example 'OPENCV 1920 1080 fx fy cx cy k1 k2 p1 p2'; needed if the "
        "file of poses has no intrinsics. Without --poses, lazyloc run keeps these intrinsics, and computes only poses",
    )
    add(
        "--calibration",
        type=pathlib.Path,
        metavar="FILE",
        help="file with the intrinsics and, if the poses are of the robot or vehicle, the mounting of the camera: "
        "sensor.yaml (EuRoC), camchain.yaml (Kalibr), calib.txt (KITTI) or calib_cam_to_pose.txt (KITTI-360)",
    )
    add(
        "--crs",
        help="coordinate reference system of the positions, for example EPSG:32632; default: the system that the "
        "file names, or a local frame",
    )
    add(
        "--geo_origin",
        metavar="LAT,LON,HEIGHT",
        help="origin of the local frame for geographic coordinates; default: the mean camera position",
    )
    add(
        "--pose_direction",
        choices=DIRECTIONS,
        help="direction of the poses, if the file differs from its format: cam_from_world means x_cam = R x_world + t",
    )
    add(
        "--camera_axes",
        choices=list(CAMERA_AXES),
        help="camera axes, if the file differs from its format: opencv (x right, y down, z forward), "
        "opengl (x right, y up, z backward), body (x forward, y left, z up), frd (x forward, y right, z down), rfu (x "
        "right, y forward, z up)",
    )
    add(
        "--quaternion_order",
        choices=QUATERNION_ORDERS,
        help="order of the numbers in a quaternion, if the file differs from its format",
    )


def join_values(arguments: Sequence[str] | None) -> list[str]:
    """Returns the words of a command line, in which a southern --geo_origin is joined with its option: argparse takes
    -33.0,151,0 for an option."""
    words: list[str] = []
    for word in sys.argv[1:] if arguments is None else arguments:
        if words and words[-1] == "--geo_origin" and re.match(r"-[\d.]", word):
            words[-1] += f"={word}"
        else:
            words.append(word)
    return words


def make_source(path: pathlib.Path, image_path: pathlib.Path | None, options: argparse.Namespace) -> Source:
    """Returns a file with what the options specify for it."""
    return Source(
        path,
        Photos(image_path),
        None if options.camera is None else Camera.parse("--camera", options.camera),
        options.calibration,
        options.crs,
        None if options.geo_origin is None else GeoOrigin.parse(options.geo_origin),
        options.pose_direction,
        options.camera_axes,
        options.quaternion_order,
    )


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    titles = {AUTO: "recognized from the content of FILE", **{name: form.title for name, form in FORMATS.items()}}
    titles[EXIF] = "a folder of photos, whose GPS positions are written"
    titles[PANORAMAS] = "a folder of equirectangular photos, which are cut into perspective images"
    rows = "".join(f"  {name:<15} {title}\n" for name, title in titles.items())
    parser = Parser(
        prog="lazyloc import",
        description=(__doc__ or "").replace("FORMATS\n", rows),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("format", metavar="FORMAT", choices=list(titles), help="format of FILE")
    add(
        "file",
        metavar="FILE",
        type=pathlib.Path,
        help="file of poses, or a folder, for example of a COLMAP model or of a scene of 7 Scenes",
    )
    add("--output_path", type=pathlib.Path, required=True, help="folder to write; for exif, the text file to write")
    add(
        "--image_path",
        type=pathlib.Path,
        help="folder of the photos. Poses of photos that are not in this folder are left out, and the images of the "
        "model get the names of the photos",
    )
    add("--binary", action="store_true", help="write binary files; default: text")
    add(
        "--model",
        type=pathlib.Path,
        help="for exif: model with geo.json, to whose coordinates the positions are converted; default: a local frame "
        "at the mean position of the photos",
    )
    add(
        "--rig_config_path",
        type=pathlib.Path,
        metavar="FILE",
        help="rig calibration, if the poses are of the rig's reference camera; the poses of the other cameras are "
        "computed from it",
    )
    add(
        "--poses",
        type=pathlib.Path,
        metavar="FILE",
        help="for panoramas: poses of the panoramas, in any format; the command then also writes a model of the "
        "perspective images",
    )
    add_source_options(add)
    add_accept_option(add)
    return parser.parse_args(join_values(arguments))


@command(name="lazyloc import", extra="import")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    _refuse_unused(options)
    if options.format == EXIF:
        _write_gps(options)
        return
    if options.format == PANORAMAS:
        _cut_panoramas(options)
        return
    if options.output_path.is_file():
        raise InputError(f"--output_path {options.output_path}: is not a folder")
    source = make_source(options.file, options.image_path, options)
    posed = _read(source, options)
    if options.output_path.resolve() == options.file.resolve():
        raise InputError(f"--output_path {options.output_path}: is the folder of the poses")
    if options.image_path is not None:
        check_photos(posed, options.image_path, str(options.file), options.accept_poses)
    write_posed_images(options.output_path, posed, options.binary)
    num_cameras = len({image.camera for image in posed.images})
    print(f"{options.output_path}: {len(posed.images)} images, {num_cameras} camera{'s' * (num_cameras > 1)}")
    photos, posed_names = source.photos.names, {image.name for image in posed.images}
    missing = [name for name in photos if name not in posed_names]
    if missing:
        logger.warning(
            "%d of %d photos have no pose in %s: %s", len(missing), len(photos), options.file, some_of(missing)
        )
    _check_sizes(source, posed)


def _refuse_unused(options: argparse.Namespace) -> None:
    """Refuses options that the format does not use."""
    names = UNUSED.get(options.format, UNUSED[AUTO])
    if options.format == PANORAMAS and options.poses is None:
        names += (*CONVENTION_OPTIONS, "geo_origin", "binary")
    for name in names:
        if getattr(options, name):
            raise InputError(f"--{name}: has no effect with the format {options.format}")


def _read(source: Source, options: argparse.Namespace) -> PosedImages:
    """Reads the poses, of a rig those of its reference camera, from which those of the others follow."""
    form = None if options.format == AUTO else options.format
    if options.rig_config_path is None:
        return read_posed_images(source, form)
    if options.image_path is None:
        raise InputError("--rig_config_path needs --image_path, which has the photos of all cameras")
    rig = Rig.read(options.rig_config_path)
    photos = Photos(options.image_path, rig.reference)
    return rig.add_cameras(read_posed_images(dataclasses.replace(source, photos=photos), form), source.photos)


def _check_sizes(source: Source, posed: PosedImages) -> None:
    """Names a photo of each camera that has another size, whose intrinsics are those of other pixels."""
    if source.photos.folder is None:
        return
    for camera, name in {image.camera: image.name for image in posed.images}.items():
        try:
            size = source.photos.size(name)
        except InputError as error:
            logger.warning("%s", error)
            continue
        if size != (camera.width, camera.height):
            logger.warning(
                "%s has %d x %d pixels, but its camera %d x %d: give intrinsics of this size (--camera)",
                source.photos.folder / name,
                *size,
                camera.width,
                camera.height,
            )


def _write_gps(options: argparse.Namespace) -> None:
    """Writes the positions of photos with GPS, and geo.json if no model has an origin."""
    given = None if options.geo_origin is None else GeoOrigin.parse(options.geo_origin)
    if options.model is not None:
        if given is not None:
            raise InputError("--geo_origin: cannot be given with --model, which has its own origin")
        given = GeoOrigin.read(options.model)
        if given is None:
            raise InputError(f"--model {options.model}: has no {FILE_NAME}, so that it is not geographic")
    positions = exif_gps.read_positions(options.file)
    options.output_path.parent.mkdir(parents=True, exist_ok=True)
    origin = exif_gps.write_positions(options.output_path, positions, given)
    print(f"{options.output_path}: {len(positions)} positions")
    if options.model is None:
        origin.write(options.output_path.parent)


def _cut_panoramas(options: argparse.Namespace) -> None:
    """Writes the faces of panoramas, their rig and a list of queries; with poses also the model of the faces."""
    paths, output = panoramas.list_panoramas(options.file), options.output_path
    widths = panoramas.find_widths(paths)
    posed = None
    if options.poses is not None:
        posed = panoramas.read_face_poses(make_source(options.poses, options.file, options), widths, None)
    panoramas.write_faces(paths, output / "images")
    panoramas.write_rig(output / "rig.json")
    cameras = panoramas.face_cameras(widths)
    lines = (f"{name} {camera.text()}\n" for name, camera in sorted(cameras.items()))
    (output / "queries.txt").write_text("".join(lines), encoding="utf-8")
    if posed is not None:
        write_posed_images(output / "model", posed, options.binary)
    print(f"{output}: {len(widths)} panoramas, {len(cameras)} faces")


if __name__ == "__main__":
    sys.exit(main())

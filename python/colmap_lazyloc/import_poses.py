"""Makes a COLMAP model, cameras and poses without points, from a file of another program.

    lazyloc import FORMAT FILE --output_path MODEL --image_path photos

FORMAT is one of the following; `auto` tells by the content of FILE.

FORMATS
The format `exif` reads GPS positions of the photos in the folder FILE instead, and writes a text file for
`colmap lazy_localizer --query_position_path`. The format `panoramas` cuts the equirectangular photos in the folder FILE
into perspective faces, and writes rig.json and queries.txt beside them.

Geographic coordinates become a local frame in metres: x east, y north, z up. Its origin is in geo.json beside the
model.
"""

import argparse
import dataclasses
import pathlib
import sys
from collections.abc import Callable, Sequence
from typing import Any

from colmap_lazyloc import panoramas
from colmap_lazyloc.errors import InputError, command, logger
from colmap_lazyloc.model import Camera, Image, write_model
from colmap_lazyloc.pose_formats import exif_gps
from colmap_lazyloc.pose_formats.geo import FILE_NAME, GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import Photos, PosedImages, Source
from colmap_lazyloc.pose_formats.registry import FORMATS, read_posed_images
from colmap_lazyloc.pose_formats.rigs import Rig

AUTO, EXIF, PANORAMAS = "auto", "exif", "panoramas"
MODEL_FILES = ("cameras", "images", "points3D", "rigs", "frames")


def write_posed_images(folder: pathlib.Path, posed: PosedImages, binary: bool = False, prefix: str = "") -> None:
    """Writes a COLMAP model, with a camera for each set of intrinsics; replaces an earlier model in the folder."""
    images = sorted(posed.images, key=lambda image: image.name)
    camera_ids: dict[Camera, int] = {}
    for image in images:
        camera_ids.setdefault(image.camera, len(camera_ids) + 1)
    for name in MODEL_FILES:
        for suffix in (".bin", ".txt"):
            (folder / (name + suffix)).unlink(missing_ok=True)
    (folder / FILE_NAME).unlink(missing_ok=True)
    records = [
        Image(prefix + image.name, camera_ids[image.camera], image.cam_from_world, image_id)
        for image_id, image in enumerate(images, start=1)
    ]
    write_model(folder, {camera_id: camera for camera, camera_id in camera_ids.items()}, records, binary)
    if posed.origin is not None:
        posed.origin.write(folder)


def add_source_options(add: Callable[..., Any]) -> None:
    """Adds the options that say more about a file of poses; `add`: the function of an argument parser."""
    add(
        "--camera",
        metavar="'MODEL W H PARAMS...'",
        help="intrinsics of all images, as in a list of queries: 'OPENCV 1920 1080 fx fy cx cy k1 k2 p1 p2'; needed if "
        "the file has none",
    )
    add(
        "--calibration",
        type=pathlib.Path,
        metavar="FILE",
        help="intrinsics of the camera, and its pose on the body whose trajectory FILE has: sensor.yaml of EuRoC, "
        "camchain.yaml of Kalibr, or calib.txt of KITTI",
    )
    add(
        "--crs",
        help="coordinate reference system of x, y, z in a CSV file, for example EPSG:32632; default: a local frame",
    )
    add(
        "--geo_origin",
        metavar="LAT,LON,HEIGHT",
        help="origin of the local frame for geographic coordinates; default: the mean of the cameras",
    )


def make_source(path: pathlib.Path, image_path: pathlib.Path | None, options: argparse.Namespace) -> Source:
    """Returns a file with what the options say about it."""
    return Source(
        path,
        Photos(image_path),
        None if options.camera is None else Camera.parse("--camera", options.camera),
        options.calibration,
        options.crs,
        None if options.geo_origin is None else GeoOrigin.parse(options.geo_origin),
    )


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    rows = "".join(f"  {name:<15} {form.title}\n" for name, form in FORMATS.items())
    parser = argparse.ArgumentParser(
        prog="lazyloc import",
        description=(__doc__ or "").replace("FORMATS\n", rows),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("format", metavar="FORMAT", choices=[AUTO, *FORMATS, EXIF, PANORAMAS], help="the format of FILE")
    add("file", metavar="FILE", type=pathlib.Path, help="file of poses; for colmap, exif and panoramas a folder")
    add("--output_path", type=pathlib.Path, required=True, help="folder of the model or of the faces; for exif a file")
    add(
        "--image_path",
        type=pathlib.Path,
        help="folder of the photos: only their poses are taken, and the names are those of their files",
    )
    add("--binary", action="store_true", help="write binary files; default: text")
    add(
        "--model",
        type=pathlib.Path,
        help="for exif, the model whose coordinates (geo.json) the positions shall have; default: the mean position of "
        "the photos is the origin",
    )
    add(
        "--rig_config_path",
        type=pathlib.Path,
        metavar="FILE",
        help="calibration of a rig, whose reference camera FILE has the poses of: the other cameras get theirs, too",
    )
    add(
        "--poses",
        type=pathlib.Path,
        metavar="FILE",
        help="for panoramas, a file of their poses in any of the formats: the model of their faces is written, too",
    )
    add_source_options(add)
    return parser.parse_args(arguments)


@command(name="lazyloc import", extra="import")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    if options.format == EXIF:
        _write_gps(options)
        return
    if options.format == PANORAMAS:
        _cut_panoramas(options)
        return
    source = make_source(options.file, options.image_path, options)
    posed = _read(source, options)
    if options.output_path.resolve() == options.file.resolve():
        raise InputError(f"--output_path {options.output_path}: is the folder of the poses")
    write_posed_images(options.output_path, posed, options.binary)
    num_cameras = len({image.camera for image in posed.images})
    print(f"{options.output_path}: {len(posed.images)} images, {num_cameras} camera{'s' * (num_cameras > 1)}")
    num_photos = len(source.photos.names)
    if len(posed.images) < num_photos:
        logger.warning("%d of %d photos have no pose in %s", num_photos - len(posed.images), num_photos, options.file)


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


def _write_gps(options: argparse.Namespace) -> None:
    """Writes the positions of photos with GPS, and geo.json if no model says the origin."""
    given = None if options.geo_origin is None else GeoOrigin.parse(options.geo_origin)
    if options.model is not None:
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

"""Checks whether the poses of a COLMAP model fit the feature matches in a database.

    lazyloc check database.db model

The command compares the verified matches of up to 60 image pairs with the poses. If they do not fit, it looks for a
common mistake: other camera axes, inverse poses, photos in another order, and more. It also lists images whose poses
contradict the other poses. It cannot detect a wrong scale, or a shift or rotation of all poses together. The exit code
is 2 if the poses are wrong.
"""

import argparse
import pathlib
import sqlite3
import sys
from collections.abc import Sequence

from colmap_lazyloc.agreement.check import judge_database
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.errors import InputError, Parser, command
from colmap_lazyloc.model import read_model
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage

WRONG_POSES = 2  # exit code


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(prog="lazyloc check", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("database", type=pathlib.Path, metavar="DATABASE", help="COLMAP database with verified matches")
    parser.add_argument("model", type=pathlib.Path, metavar="MODEL", help="folder of a COLMAP model")
    return parser.parse_args(arguments)


@command(name="lazyloc check", extra="import")
def main(arguments: Sequence[str] | None = None) -> int:
    options = parse_arguments(arguments)
    model = read_model(options.model)
    images = [
        PosedImage(image.name, model.cameras[image.camera_id], image.pose)
        for image in sorted(model.images.values(), key=lambda image: image.image_id)
        if image.cam_from_world is not None
    ]
    if not options.database.is_file():
        raise InputError(f"{options.database}: does not exist")
    try:
        with DatabaseReader(options.database) as database:
            found = judge_database(database, images, GeoOrigin.read(options.model) is not None)
    except sqlite3.Error as error:
        raise InputError(f"{options.database}: is not a readable COLMAP database: {error}") from None
    if found is None:
        raise InputError(f"{options.database}: too few pairs of images of {options.model} are matched")
    print("\n".join(found.lines()))
    if found.options:
        print(f"to mend them: lazyloc import colmap {options.model} {found.options} --output_path MENDED")
    return WRONG_POSES if found.is_wrong else 0


if __name__ == "__main__":
    sys.exit(main())

"""Writes the poses of localized photos in the format of another program.

    lazyloc export RESULTS --format FORMAT --output PATH

RESULTS is the output folder of `colmap lazy_localizer` or of `lazyloc run`. FORMAT is one of the following formats.
`lazyloc import` can read all of these formats except EXPORTS.

FORMATS
Poses keep the coordinates of the model. Formats with latitude and longitude need a model with geo.json. The command
prints a line that names the data that the format cannot store.
"""

import argparse
import pathlib
import sys
from collections import Counter
from collections.abc import Sequence

from colmap_lazyloc.errors import InputError, Parser, command, logger
from colmap_lazyloc.model import Model, read_model
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages
from colmap_lazyloc.pose_formats.registry import EXPORTS, write_posed_images, written_formats
from colmap_lazyloc.pose_formats.transforms_json import read_frame
from colmap_lazyloc.pose_formats.writing import Target, check_path
from colmap_lazyloc.report.output import replacing
from colmap_lazyloc.result_fields import ResultFields
from colmap_lazyloc.results import MODEL, RESULTS, find_results, pose_of, read_fields_of_view, read_results

OVERWRITE = "--overwrite"


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    forms = written_formats()
    folders = ", ".join(name for name, form in forms.items() if form.writer.folder is not None)
    rows = "".join(f"  {name:<15} {form.title}\n" for name, form in forms.items())
    parser = Parser(
        prog="lazyloc export",
        description=(__doc__ or "").replace("EXPORTS", ", ".join(EXPORTS)).replace("FORMATS\n", rows),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("results", metavar="RESULTS", type=pathlib.Path, help="output folder of a run")
    add("--format", choices=list(forms), required=True, metavar="FORMAT", help="one of the formats above")
    add(
        "--output",
        type=pathlib.Path,
        required=True,
        metavar="PATH",
        help=f"file to write; for {folders} a folder",
    )
    add(
        "--with_database",
        action="store_true",
        help="also write the poses of the database images; default: only the localized photos",
    )
    add(
        "--crs",
        help="for realitycapture: coordinate reference system of the positions, for example EPSG:32632; default: the "
        "coordinates of the model",
    )
    add(
        "--transforms",
        type=pathlib.Path,
        metavar="FILE",
        help="for transforms: dataparser_transforms.json of a nerfstudio training, or transforms.json of its data; "
        "the poses are written in the coordinates of this file",
    )
    add(
        OVERWRITE,
        nargs="?",
        type=int,
        choices=(0, 1),
        const=1,
        default=0,
        help="replace PATH if it exists; default: 0",
    )
    return parser.parse_args(_with_values(sys.argv[1:] if arguments is None else arguments))


def _with_values(words: Sequence[str]) -> list[str]:
    """Returns the words of a command line, in which --overwrite has a value. Users may leave it out, but then argparse
    would take RESULTS for it."""
    joined: list[str] = []
    for word in words:
        if word in ("0", "1") and joined and joined[-1] == f"{OVERWRITE}=1":
            joined[-1] = f"{OVERWRITE}={word}"
        else:
            joined.append(f"{OVERWRITE}=1" if word == OVERWRITE else word)
    return joined


def read_localized(folder: pathlib.Path, with_database: bool = False) -> PosedImages:
    """Reads the localized photos of a run, and with `with_database` the database images; says how many photos have no
    pose."""
    results = read_results(folder / RESULTS)
    model = read_model(folder / MODEL)
    localized = _localized(folder, results, model)
    names = {name for name in model.images if name in localized or (with_database and name not in results)}
    views = read_fields_of_view(folder)
    images = [
        PosedImage(name, model.cameras[image.camera_id], image.pose, results.get(name), views.get(name, ()))
        for name, image in sorted(model.images.items())
        if name in names
    ]
    return PosedImages(images, GeoOrigin.read(folder / MODEL))


def _localized(folder: pathlib.Path, results: dict[str, ResultFields], model: Model) -> set[str]:
    """Returns the names of the localized photos, which the model must have."""
    localized = {name for name, result in results.items() if pose_of(result) is not None}
    missing = sorted(localized - set(model.images))
    if missing:
        raise InputError(f"{folder / MODEL}: is not the model of this run: query '{missing[0]}' is missing")
    others = Counter(result["status"] for name, result in results.items() if name not in localized)
    if others:
        statuses = ", ".join(f"{count} {status}" for status, count in others.most_common())
        logger.warning(
            "%d of %d photos left out, because they are not localized: %s", others.total(), len(results), statuses
        )
    if not localized:
        raise InputError(f"{folder / RESULTS}: no photo is localized")
    return localized


@command(name="lazyloc export", extra="import")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    output = options.output
    check_path(output, written_formats()[options.format].writer, options.overwrite)
    if options.transforms is not None and options.format != "transforms":
        raise InputError(f"--transforms {options.transforms}: has no effect with the format {options.format}")
    folder = find_results(options.results)
    if output.resolve() == (folder / MODEL).resolve():
        raise InputError(f"--output {output}: is the model of the results")
    similarity = None if options.transforms is None else read_frame(options.transforms)
    posed = read_localized(folder, options.with_database)
    with replacing(output) as staged:
        count = write_posed_images(staged, posed, options.format, Target(options.crs, similarity))
    print(f"{output}: {count} poses")


if __name__ == "__main__":
    sys.exit(main())

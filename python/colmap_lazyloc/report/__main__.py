"""Writes a report of a finished run: one HTML file that a browser opens without a server."""

import argparse
import pathlib
import sys

import numpy as np

from colmap_lazyloc.errors import command
from colmap_lazyloc.evaluate import read_any_poses
from colmap_lazyloc.report.chunk import pack
from colmap_lazyloc.report.details import DETAILS_PER_BLOCK, detail_chunk
from colmap_lazyloc.report.page import single_page
from colmap_lazyloc.report.run import read_run
from colmap_lazyloc.report.scene import query_cameras, scene_chunk
from colmap_lazyloc.report.scene_points import choose_points
from colmap_lazyloc.report.summary import summary_chunk
from colmap_lazyloc.report.table import query_chunk


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=pathlib.Path, help="output folder of colmap lazy_localizer")
    parser.add_argument("--ground_truth", type=pathlib.Path, help="true poses: poses file, or folder of a COLMAP model")
    parser.add_argument("--max_num_points", type=int, default=1000000, help="maximum number of points")
    parser.add_argument("--output", type=pathlib.Path, required=True, help="file to write")
    return parser.parse_args(arguments)


@command
def main(arguments=None):
    options = parse_arguments(arguments)
    truth = None if options.ground_truth is None else read_any_poses(options.ground_truth)
    run = read_run(options.run, truth)
    points = choose_points(run, options.max_num_points)
    none = np.full(len(run.queries), -1)
    chunks = {
        "summary": pack(summary_chunk(run, {"points": len(points.xyz), "photos": 0}, [], []), {}),
        "queries": pack(*query_chunk(run, none, none * 0)),
        "scene": pack(*scene_chunk(run, query_cameras(run, {}), points)),
    }
    for block in range((len(run.queries) - 1) // DETAILS_PER_BLOCK + 1):
        chunks[f"details/{block}"] = pack(*detail_chunk(run, block, {}))
    page = single_page(run.path.resolve().name, chunks, [])
    options.output.write_text(page, encoding="utf-8")
    print(f"{options.output}: {len(page) / 1e6:.1f} MB")


if __name__ == "__main__":
    sys.exit(main())

"""Starts a benchmark from the project's root: python -m benchmarks COMMAND [--help]."""

import importlib
import sys

COMMANDS = {
    "epoch": ("epoch", "new photos localized alone, adjusted together, and in a model that may move everything"),
    "epoch_size": ("epoch_size", "time and memory of a second epoch of 50 to 2,000 photos, beside COLMAP's mapper"),
    "run": ("localization.run", "several methods on the scenes of a dataset: tables, plots, figures as CSV"),
    "compare": ("localization.compare", "runs side by side, or against expected figures; fails on a regression"),
    "groups": ("localization.groups", "queries localized jointly, as frames of a rig, as pieces of a trajectory"),
    "photos": ("photos.compare_with_database", "queries that are only photos against queries of the database"),
    "retrieval": ("photos.retrieval", "what the retrieval index finds, its size and times"),
    "orientations": ("photos.orientations", "photos stored in each orientation of EXIF, against upright ones"),
    "photometric_stress": (
        "photos.photometric_stress",
        "photos in the dark, out of focus, in haze, by SIFT and ALIKED",
    ),
    "poses": ("corrupted_poses", "poses that are wrong in the ways of people's files: are they named?"),
    "runtime": ("runtime.compare_with_local_triangulation", "seconds per query beside pycolmap's, on one core"),
    "service": ("service", "lazyloc serve with 1, 8 and 64 clients, beside localize_all"),
    "streaming": ("streaming", "memory and time of one process over the number of queries"),
    "sparse": (
        "localization.sparse",
        "one to four database images, with and without points in common; other methods beside",
    ),
    "uncertainty": ("uncertainty.report", "reported covariances against true errors of synthetic scenes"),
    "uncalibrated": ("uncertainty.uncalibrated", "photos without intrinsics, also of weak perspective"),
    "reconstructions": (
        "uncertainty.reconstructions",
        "nothing: reconstructs photos with COLMAP's defaults, as scenes",
    ),
    "seven_scenes_layout": ("localization.datasets.seven_scenes_layout", "writes a scene in the layout of 7 Scenes"),
}


def main(arguments: list[str]) -> int:
    if not arguments or arguments[0] not in COMMANDS:
        lines = (f"  {name:<21}{text}\n" for name, (_, text) in COMMANDS.items())
        print(f"{__doc__}\n\n{''.join(lines)}", end="", file=sys.stderr)
        return 1
    sys.argv[0] = f"python -m benchmarks {arguments[0]}"  # argparse prints it as the program's name
    return importlib.import_module(f"benchmarks.{COMMANDS[arguments[0]][0]}").main(arguments[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
"""Localizes the queries of scenes with several methods on the same matches and compares the position errors.

Writes TAG.csv (a row per scene, query and method) and TAG.md (the tables) to --output_path. A run with a tag that is
there already adds to it: what it runs anew replaces the old rows, the others stay.
"""

import argparse
import concurrent.futures
import multiprocessing
import pathlib
import sys

import tables
from evaluation import make_row, read_csv, write_csv
from methods import METHODS, MethodOptions, NotApplicable, load_method
from scenes import Scene, find_scenes, load_scene

CONFIGS_PATH = pathlib.Path(__file__).resolve().parent / "configs"


def main(argv: list[str]) -> int:
    arguments = _parse(argv)
    output_path = arguments.output_path
    output_path.mkdir(parents=True, exist_ok=True)
    csv_path, markdown_path = output_path / f"{arguments.tag}.csv", output_path / f"{arguments.tag}.md"
    rows = read_csv(csv_path) if csv_path.exists() else []
    reasons = {}
    for scene_name in arguments.scenes:
        scene = load_scene(arguments.scenes_path / scene_name)
        for method in arguments.methods:
            rows = [row for row in rows if (row.scene, row.method) != (scene_name, method)]
            query_names = scene.query_names[: arguments.max_num_queries]
            results, reason = run_method(method, scene, query_names, _options(arguments, scene_name, method))
            if reason:
                reasons[scene_name, method] = reason
            rows += [make_row(arguments.tag, scene, name, method, result) for name, result in results.items()]
            # After every step, so that a run that is broken off leaves what it has found.
            write_csv(csv_path, rows)
            markdown_path.write_text(tables.markdown(arguments.tag, rows, reasons))
            print(f"{scene_name} {method}: {reason or f'{len(results)} queries'}", file=sys.stderr, flush=True)
    print(markdown_path.read_text())
    return 0


def run_method(method: str, scene: Scene, query_names: list[str], options: MethodOptions) -> tuple[dict, str]:
    """In a process of its own: neither an exception nor a crash of a method stops the others. Results, or a reason."""
    context = multiprocessing.get_context("fork")
    with concurrent.futures.ProcessPoolExecutor(max_workers=1, mp_context=context) as executor:
        try:
            return executor.submit(_localize, method, scene, query_names, options).result(), ""
        except NotApplicable as reason:
            return {}, str(reason)
        except concurrent.futures.process.BrokenProcessPool:
            return {}, "crashed"
        except Exception as error:  # of any library
            return {}, f"failed: {type(error).__name__}: {error}"


def _localize(method: str, scene: Scene, query_names: list[str], options: MethodOptions) -> dict:
    return load_method(_split_preset(method)[0])(scene, query_names, options)


def _options(arguments: argparse.Namespace, scene_name: str, method: str) -> MethodOptions:
    preset = _split_preset(method)[1]
    return MethodOptions(
        work_path=arguments.output_path / "work" / scene_name / method.replace(":", "_"),
        colmap_path=arguments.colmap,
        num_retrieved=arguments.num_retrieved,
        seed=arguments.seed,
        preset_path=CONFIGS_PATH / f"{preset}.ini" if preset else None,
        program_options=tuple(tuple(option.split("=", 1)) for option in arguments.options))


def _split_preset(method: str) -> tuple[str, str]:
    name, _, preset = method.partition(":")
    return name, preset


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes_path", type=pathlib.Path, required=True,
                        help="folder of scenes, each with model/, database.db and perhaps queries.txt")
    parser.add_argument("--scenes", nargs="+", help="names below --scenes_path; default: all")
    parser.add_argument("--methods", nargs="+", default=["structure_based", "lazyloc"],
                        help=f"of {', '.join(METHODS)}; lazyloc:NAME takes options from configs/NAME.ini")
    parser.add_argument("--colmap", type=pathlib.Path, default=pathlib.Path("build/bin/colmap"),
                        help="the program with the command lazy_localizer")
    parser.add_argument("--options", nargs="+", default=[], metavar="KEY=VALUE",
                        help="further options of lazy_localizer, for example LazyLocalizer.loss_scale_px=0.5")
    parser.add_argument("--num_retrieved", type=int, default=20, help="pairs per query, best by verified inliers")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--max_num_queries", type=int, help="of each scene: for a quick look")
    parser.add_argument("--output_path", type=pathlib.Path, required=True)
    parser.add_argument("--tag", default="run", help="name of this run and of its files")
    arguments = parser.parse_args(argv)
    arguments.scenes = arguments.scenes or find_scenes(arguments.scenes_path)
    if not arguments.scenes:
        parser.error(f"--scenes_path: no scene with a database.db below {arguments.scenes_path}")
    for name in arguments.scenes:
        if not (arguments.scenes_path / name / "database.db").exists():
            parser.error(f"--scenes: {arguments.scenes_path / name / 'database.db'} does not exist")
    for method in arguments.methods:
        name, preset = _split_preset(method)
        if name not in METHODS or (preset and name != "lazyloc"):
            parser.error(f"--methods: {method} is not one of {', '.join(METHODS)} or lazyloc:NAME")
        if preset and not (CONFIGS_PATH / f"{preset}.ini").exists():
            parser.error(f"--methods: {CONFIGS_PATH / preset}.ini does not exist")
    for option in arguments.options:
        if "=" not in option:
            parser.error(f"--options: {option} is not KEY=VALUE")
    return arguments


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

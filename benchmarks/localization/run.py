"""Localizes the queries of a dataset's scenes with several methods on the same matches and compares the errors.

    python -m benchmarks run --data_path DATA --output_path OUT

Writes to --output_path: TAG.csv (one row per scene, query and method), TAG.md (tables), TAG_*.svg (plots, with --plots)
and, if the true poses are not public, TAG_*_visuallocalization_net.txt for submission. All poses are written to
poses/TAG below --work_path. If TAG.csv already exists, new rows replace those of the same scene, method and settings;
other rows are kept.
"""

import argparse
import concurrent.futures
import hashlib
import itertools
import multiprocessing
import pathlib
import sys

from benchmarks.localization import datasets, tables
from benchmarks.localization.database_noise import add_database_noise
from benchmarks.localization.datasets.scene_source import Options
from benchmarks.localization.environment import describe_environment
from benchmarks.localization.evaluation import Series, make_row, read_csv, write_csv
from benchmarks.localization.methods import ABLATIONS, METHODS, MethodOptions, NotApplicable, load_method
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.errors import InputError, command
from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.poses import Pose, write_poses
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.queries import read_queries

CONFIGS_PATH = pathlib.Path(__file__).resolve().parent / "configs"


@command
def main(arguments=None):
    arguments = _parse(arguments)
    if arguments.download:
        datasets.download_scenes(arguments.dataset, arguments.data_path, arguments.scenes)
    found = datasets.scene_names(arguments.dataset, arguments.data_path)
    for name in arguments.scenes or ():
        if name not in found:
            raise InputError(f"--scenes: {name} is not in {arguments.data_path}, which has {', '.join(found)}")
    run(arguments, arguments.scenes or found)


def run(arguments: argparse.Namespace, scene_names: list[str]):
    output_path = arguments.output_path
    output_path.mkdir(parents=True, exist_ok=True)
    csv_path, markdown_path = output_path / f"{arguments.tag}.csv", output_path / f"{arguments.tag}.md"
    rows = read_csv(csv_path) if csv_path.exists() else []
    reasons = {}
    command_line = " ".join(arguments.argv).replace(f"{pathlib.Path.cwd()}/", "")
    notes = [*describe_environment(), f"`python -m benchmarks run {command_line}`"]
    all_series = [
        Series(*values)
        for values in itertools.product(
            arguments.methods, arguments.num_retrieved, arguments.seeds, arguments.database_noise
        )
    ]
    for scene_name in scene_names:
        exact_scene = _in_own_process(_prepare, arguments, scene_name)
        query_names = _choose_queries(exact_scene, arguments.queries)
        for series in all_series:
            scene = _with_noise(exact_scene, series, arguments.work_path)
            rows = [row for row in rows if (row.scene, row.series) != (scene.name, series)]
            results, reason = run_method(series.method, scene, query_names, _options(arguments, scene, series))
            if reason:
                reasons[scene.name, series] = reason
            rows += [make_row(arguments.tag, scene, name, series, result) for name, result in results.items()]
            _write_poses(arguments, scene, series, results)
            # Write after every step, so that an interrupted run keeps its results.
            write_csv(csv_path, rows)
            markdown_path.write_text(tables.markdown(arguments.tag, rows, reasons, notes))
            print(
                f"{scene.name} {tables.labels(all_series)[series]}: {reason or f'{len(results)} queries'}",
                file=sys.stderr,
                flush=True,
            )
    if arguments.plots:
        from benchmarks.localization.plots import write_plots  # imported here, because only plots need matplotlib

        write_plots(output_path, arguments.tag, rows)
    print(markdown_path.read_text())


def run_method(method: str, scene: Scene, query_names: list[str], options: MethodOptions) -> tuple[dict, str]:
    """Returns results, or a reason; neither an exception nor a crash of a method may stop the others."""
    try:
        return _in_own_process(_localize, method, scene, query_names, options), ""
    except NotApplicable as reason:
        return {}, str(reason)
    except concurrent.futures.process.BrokenProcessPool:
        return {}, "crashed"
    except Exception as error:  # any library may raise one
        return {}, f"failed: {type(error).__name__}: {error}"


def _in_own_process(function, *arguments):
    """Calls a function in a new process, because threads that a library starts here could block later forks."""
    context = multiprocessing.get_context("fork")
    with concurrent.futures.ProcessPoolExecutor(max_workers=1, mp_context=context) as executor:
        return executor.submit(function, *arguments).result()


def _localize(method: str, scene: Scene, query_names: list[str], options: MethodOptions) -> dict:
    return load_method(_split_preset(method)[0])(scene, query_names, options)


def _prepare(arguments: argparse.Namespace, scene_name: str) -> Scene:
    from benchmarks.localization.datasets.builder import MatchingOptions

    pairs = tuple(pair for path in arguments.pairs_path for pair in read_pairs(path)) or None
    options = Options(arguments.ground_truth, arguments.focal_length_px, arguments.image_step)
    matching = MatchingOptions(arguments.max_num_features, pairs, arguments.num_database_neighbours)
    return datasets.prepare_scene(
        arguments.dataset,
        arguments.data_path,
        scene_name,
        options,
        matching,
        arguments.work_path / "scenes" / scene_name,
    )


def _with_noise(scene: Scene, series: Series, work_path: pathlib.Path) -> Scene:
    rotation_deg, position_cm = map(float, series.database_noise.split(","))
    if not rotation_deg and not position_cm:
        return scene
    path = work_path / "noise" / f"{scene.name}_{series.database_noise}_{series.seed}"
    return add_database_noise(scene, rotation_deg, position_cm, series.seed, path)


def _choose_queries(scene: Scene, queries: str | None) -> list[str]:
    """Returns the first queries, if a number is given, or those listed in a file."""
    if queries is None or queries.isdigit():
        return scene.query_names[: int(queries) if queries else None]
    wanted = read_queries(queries)
    chosen = [name for name in scene.query_names if name in wanted]
    if not chosen:
        raise InputError(f"--queries: {queries} lists no query of {scene.name}")
    return chosen


def _options(arguments: argparse.Namespace, scene: Scene, series: Series) -> MethodOptions:
    name, preset = _split_preset(series.method)
    folder = f"{series.method.replace(':', '_')}_{series.seed}"
    return MethodOptions(
        work_path=arguments.work_path / f"{scene.name}_{_fingerprint(scene)}" / folder,
        colmap_path=arguments.colmap,
        num_retrieved=series.num_retrieved,
        seed=series.seed,
        preset=preset,
        preset_path=CONFIGS_PATH / f"{preset}.ini" if preset and name == "lazyloc" else None,
        program_options=tuple(tuple(option.split("=", 1)) for option in arguments.options),
    )


def _fingerprint(scene: Scene) -> str:
    """Hashes the model and the database, so that a map of another model is never reused."""
    stat = scene.database_path.stat()
    state = hashlib.sha256(f"{scene.database_path.resolve()} {stat.st_size} {stat.st_mtime_ns}".encode())
    for path in sorted(scene.model_path.glob("[ci]*")):  # cameras and images
        state.update(path.read_bytes())
    return state.hexdigest()[:8]


def _write_poses(arguments: argparse.Namespace, scene: Scene, series: Series, results: dict):
    poses = {name: result.pose for name, result in results.items() if result.pose is not None}
    noise = "" if scene.true_images is None else f"_noise{series.database_noise}"
    stem = f"{scene.name}_{series.method.replace(':', '_')}_K{series.num_retrieved}_seed{series.seed}{noise}"
    write_poses(arguments.work_path / "poses" / arguments.tag / f"{stem}.txt", poses)
    if any(scene.true_pose(name) is None for name in results):
        write_submission(arguments.output_path / f"{arguments.tag}_{stem}_visuallocalization_net.txt", poses)


def write_submission(path: pathlib.Path, poses: dict[str, Pose]):
    """Writes poses in the form of visuallocalization.net for Aachen Day-Night: names without folders."""
    names = {name: pathlib.PurePosixPath(name).name for name in poses}
    if len(set(names.values())) < len(names):
        raise ValueError(f"{path}: two queries have the same name in different folders")
    write_poses(path, {names[name]: pose for name, pose in poses.items()})


def _split_preset(method: str) -> tuple[str, str]:
    name, _, preset = method.partition(":")
    return name, preset


def _add_data_arguments(parser: argparse.ArgumentParser):
    data = parser.add_argument_group("data")
    data.add_argument(
        "--dataset",
        choices=datasets.NAMES,
        default="scenes",
        help="layout of --data_path, see datasets/; scenes (default): folders with model/, database.db "
        "and optionally queries.txt",
    )
    data.add_argument("--data_path", type=pathlib.Path, required=True, help="folder of the dataset")
    data.add_argument("--download", action="store_true", help="download missing scenes, if their authors allow it")
    data.add_argument("--scenes", nargs="+", help="names of scenes; default: all")
    data.add_argument("--queries", help="number of queries per scene, or a file that lists them; default: all")
    data.add_argument(
        "--ground_truth",
        choices=("original", "sfm"),
        default="original",
        help="for 7scenes and cambridge: the dataset's poses, or those of structure from motion",
    )
    data.add_argument("--focal_length_px", type=float, help="focal length for 7scenes; default: 525")
    data.add_argument("--image_step", type=int, default=1, help="use every n-th database image and query")
    data.add_argument(
        "--pairs_path",
        type=pathlib.Path,
        nargs="+",
        default=[],
        help="files with pairs to match, two names per line as in hloc; default: the dataset's pairs, else all",
    )
    data.add_argument("--max_num_features", type=int, default=8192, help="SIFT features per image")
    data.add_argument(
        "--num_database_neighbours",
        type=int,
        default=20,
        help="for the map: number of nearest database images with which each database image is matched",
    )


def _add_method_arguments(parser: argparse.ArgumentParser):
    methods = parser.add_argument_group("methods")
    methods.add_argument(
        "--methods",
        nargs="+",
        default=["structure_based", "lazyloc"],
        help=f"all, or names of {', '.join(METHODS)}; lazyloc:NAME uses the options in configs/NAME.ini, "
        "ablation:NAME is the paper's method with one stage replaced",
    )
    methods.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    methods.add_argument(
        "--options",
        nargs="+",
        default=[],
        metavar="KEY=VALUE",
        help="further options of lazy_localizer, for example LazyLocalizer.intrinsics=given",
    )
    methods.add_argument(
        "--num_retrieved",
        type=int,
        nargs="+",
        default=[20],
        help="number of pairs per query, those with the most verified matches; each value is a series",
    )
    methods.add_argument("--seeds", type=int, nargs="+", default=[0], help="seeds; each value is a series")
    methods.add_argument(
        "--database_noise",
        type=_noise,
        nargs="+",
        default=["0,0"],
        metavar="DEG,CM",
        help="rotate and move each database pose by this much in random directions; each value is a series",
    )


def _add_output_arguments(parser: argparse.ArgumentParser):
    output = parser.add_argument_group("output")
    output.add_argument("--output_path", type=pathlib.Path, required=True)
    output.add_argument("--work_path", type=pathlib.Path, help="folder for databases, maps and logs; default: OUT/work")
    output.add_argument("--tag", default="run", help="name of this run and of its files")
    output.add_argument("--plots", action="store_true", help="also draw plots (needs matplotlib)")


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    _add_data_arguments(parser)
    _add_method_arguments(parser)
    _add_output_arguments(parser)
    arguments = parser.parse_args(argv)
    arguments.argv = argv
    arguments.work_path = arguments.work_path or arguments.output_path / "work"
    if arguments.methods == ["all"]:
        presets = sorted(path.stem for path in CONFIGS_PATH.glob("*.ini"))
        arguments.methods = [name for name in METHODS if name != "ablation"]
        arguments.methods += [f"lazyloc:{preset}" for preset in presets]
    _check(parser, arguments)
    return arguments


def _check(parser: argparse.ArgumentParser, arguments: argparse.Namespace):
    for method in arguments.methods:
        name, preset = _split_preset(method)
        if name not in METHODS or (preset and name not in ("lazyloc", "ablation")):
            parser.error(f"--methods: {method} is not one of {', '.join(METHODS)} or lazyloc:NAME")
        if name == "ablation" and preset and preset not in ABLATIONS:
            parser.error(f"--methods: {preset} is not one of {', '.join(ABLATIONS)}")
        if preset and name == "lazyloc" and not (CONFIGS_PATH / f"{preset}.ini").exists():
            parser.error(f"--methods: {CONFIGS_PATH / preset}.ini does not exist")
    for option in arguments.options:
        if "=" not in option:
            parser.error(f"--options: {option} is not KEY=VALUE")
    for name in ("image_step", "max_num_features"):
        if getattr(arguments, name) < 1:
            parser.error(f"--{name}: must be at least 1")
    for path in [*arguments.pairs_path, *([pathlib.Path(arguments.queries)] if _is_file(arguments.queries) else [])]:
        if not path.exists():
            parser.error(f"{path} does not exist")


def _noise(text: str) -> str:
    rotation_deg, position_cm = (float(value) for value in text.split(","))
    return f"{rotation_deg:g},{position_cm:g}"


def _is_file(queries: str | None) -> bool:
    return queries is not None and not queries.isdigit()

"""Our method: one run of `colmap lazy_localizer` for all queries of a scene.

The seconds are the program's own total per query on one thread, including reading the database.
"""

import pathlib
import shutil

from benchmarks.localization.methods import MethodOptions, Result
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import write_model
from colmap_lazyloc.program import run_colmap
from colmap_lazyloc.results import pose_of, read_results


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    work_path = options.work_path
    model_path, list_path = write_inputs(scene, query_names, work_path)
    output_path = work_path / "output"
    program_options = {
        "database_path": scene.database_path,
        "input_path": model_path,
        "output_path": output_path,
        "query_list_path": list_path,
        "LazyLocalizer.num_threads": 1,
        "LazyLocalizer.num_retrieved": options.num_retrieved,
        "LazyLocalizer.seed": options.seed,
    }
    if scene.protocol.leave_one_out:
        program_options["LazyLocalizer.leave_one_out"] = 1
    if options.preset_path:
        program_options["project_path"] = options.preset_path
    program_options.update(options.program_options)

    arguments = [text for key, value in program_options.items() for text in (f"--{key}", str(value))]
    shutil.rmtree(output_path, ignore_errors=True)  # so that no result of an earlier run is taken for a new one
    run_colmap(options.colmap_path, "lazy_localizer", *arguments, log_path=work_path / "log.txt")
    return read_method_results(output_path / "results.jsonl", query_names)


def write_inputs(scene: Scene, query_names: list[str], work_path: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """Writes the model, if queries are not localized against all other images of it, and the list of queries."""
    work_path.mkdir(parents=True, exist_ok=True)
    model_path, list_path = scene.model_path, work_path / "queries.txt"
    query_lines = query_names
    if not scene.protocol.leave_one_out:
        database_names = sorted({name for query in query_names for name in scene.database_names(query)})
        model_path = write_model(work_path / "model", scene.cameras, [scene.images[name] for name in database_names])
        query_lines = [f"{name} {scene.camera(name).text()}" for name in query_names]
    list_path.write_text("".join(line + "\n" for line in query_lines))
    return model_path, list_path


def read_method_results(path: pathlib.Path, query_names: list[str]) -> dict[str, Result]:
    """Reads results.jsonl, which must have every query."""
    records = read_results(path)
    missing = [name for name in query_names if name not in records]
    if missing:
        raise RuntimeError(f"{path} has no line for {missing[0]}")
    return {
        name: Result(pose_of(records[name]), records[name]["seconds"]["total"], records[name]["status"])
        for name in query_names
    }

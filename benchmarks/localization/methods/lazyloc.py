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
    work_path.mkdir(parents=True, exist_ok=True)
    output_path = work_path / "output"
    program_options = {
        "database_path": scene.database_path,
        "input_path": scene.model_path,
        "output_path": output_path,
        "query_list_path": work_path / "queries.txt",
        "LazyLocalizer.num_threads": 1,
        "LazyLocalizer.num_retrieved": options.num_retrieved,
        "LazyLocalizer.seed": options.seed,
    }
    if scene.protocol.leave_one_out:
        program_options["LazyLocalizer.leave_one_out"] = 1
        query_lines = query_names
    else:
        program_options["input_path"] = write_model(
            work_path / "model", scene.cameras, [scene.images[name] for name in scene.database_names(query_names[0])]
        )
        query_lines = [f"{name} {scene.camera(name).text()}" for name in query_names]
    (work_path / "queries.txt").write_text("".join(line + "\n" for line in query_lines))
    if options.preset_path:
        program_options["project_path"] = options.preset_path
    program_options.update(options.program_options)

    arguments = [text for key, value in program_options.items() for text in (f"--{key}", str(value))]
    shutil.rmtree(output_path, ignore_errors=True)  # so that no result of an earlier run is taken for a new one
    run_colmap(options.colmap_path, "lazy_localizer", *arguments, log_path=work_path / "log.txt")
    return read_method_results(output_path / "results.jsonl", query_names)


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

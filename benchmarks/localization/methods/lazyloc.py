"""Ours: one run of `colmap lazy_localizer` over all queries of a scene.

The seconds are the program's own total per query, reading the database included, on one thread.
"""

import json
import pathlib
import shutil
import subprocess

from geometry import Pose
from methods import MethodOptions, Result
from scenes import Scene, camera_text


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
        program_options["input_path"] = _write_database_model(scene, query_names[0], work_path / "model")
        query_lines = [f"{name} {camera_text(scene.camera(name))}" for name in query_names]
    (work_path / "queries.txt").write_text("".join(line + "\n" for line in query_lines))
    if options.preset_path:
        program_options["project_path"] = options.preset_path
    program_options.update(options.program_options)

    arguments = [text for key, value in program_options.items() for text in (f"--{key}", str(value))]
    command = [str(options.colmap_path), "lazy_localizer", *arguments]
    shutil.rmtree(output_path, ignore_errors=True)  # no result of an earlier run can be taken for this one's
    process = subprocess.run(command, capture_output=True, text=True)
    (work_path / "log.txt").write_text(f"{' '.join(command)}\n{process.stdout}{process.stderr}")
    if process.returncode != 0:
        last_line = (process.stderr.strip() or "no message").splitlines()[-1]
        raise RuntimeError(f"lazy_localizer ended with code {process.returncode}: {last_line}")
    return read_results(output_path / "results.jsonl", query_names)


def read_results(path: pathlib.Path, query_names: list[str]) -> dict[str, Result]:
    results = {}
    for line in path.read_text().splitlines():
        record = json.loads(line)
        pose = None
        # A status other than LOCALIZED may come with a part of a pose, which is not a localization.
        if record["status"] == "LOCALIZED":
            pose = Pose.from_qvec_tvec(record["cam_from_world"]["qvec"], record["cam_from_world"]["tvec"])
        results[record["name"]] = Result(pose, record["seconds"]["total"], record["status"])
    missing = [name for name in query_names if name not in results]
    if missing:
        raise RuntimeError(f"{path} has no line for {missing[0]}")
    return {name: results[name] for name in query_names}


def _write_database_model(scene: Scene, query_name: str, path: pathlib.Path) -> pathlib.Path:
    """The scene's model without the queries, number for number."""
    path.mkdir(parents=True, exist_ok=True)
    lines = [scene.images[name].line for name in scene.database_names(query_name)]
    (path / "images.txt").write_text("".join(line + "\n\n" for line in lines))
    (path / "cameras.txt").write_bytes((scene.model_path / "cameras.txt").read_bytes())
    (path / "points3D.txt").write_text("")
    return path

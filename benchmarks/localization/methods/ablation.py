"""The paper's method with one stage replaced: `ablation:NAME`, by the program of benchmarks/ablation.

The seconds are those of a query on one thread, including reading the database.
"""

import subprocess

import numpy as np

from benchmarks.localization.methods import MethodOptions, NotApplicable, Result
from benchmarks.localization.methods.lazyloc import write_inputs
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.poses import Pose

PROGRAM = "lazyloc_ablation_benchmark"  # beside our colmap program


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    program = options.colmap_path.with_name(PROGRAM)
    if not program.exists():
        raise NotApplicable(f"needs the program {PROGRAM} (docs/benchmarks.md, Ablation)")
    model_path, list_path = write_inputs(scene, query_names, options.work_path)
    settings = (options.num_retrieved, options.seed, int(scene.protocol.leave_one_out))
    words = [program, options.preset or "none", scene.database_path, model_path, list_path, *settings]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip())
    results = dict(_read(line) for line in done.stdout.splitlines())
    return {name: results.get(name, Result.lost(0, "NOT_LOADED")) for name in query_names}


def _read(line: str) -> tuple[str, Result]:
    name, status, seconds, *numbers = line.split("\t")
    values = [float(number) for number in numbers]
    return name, Result(Pose(np.array(values[:4]), np.array(values[4:])) if values else None, float(seconds), status)

#!/usr/bin/env python3
"""Tries the Python package beside other packages, each in an environment of its own; run by hand, it downloads them.

    scripts/python.sh tests/package_matrix.py dist/colmap_lazyloc-*.whl                      # versions of pycolmap
    scripts/python.sh tests/package_matrix.py dist/colmap_lazyloc-*.whl torch poselib        # others

In processes of their own, the other package is imported and used before and after a localization, in the parent of a
forked process and in a spawned one. None may crash, print a line to the standard error output or change a pose. The
forked child does not use the other package, because some, such as torch, hang in a forked child by themselves.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile
import textwrap

from colmap_lazyloc.testing import synthetic

PYCOLMAP_VERSIONS = ("3.10.0", "3.11.1", "3.12.6", "3.13.0", "4.0.4", "4.1.1", "4.2.1")
ORDERS = ("other first", "other last", "fork", "spawn")

PROGRAM = '''
import importlib, multiprocessing, sys
import numpy as np

def use_other(name):
    """Imports a package and calls its native code."""
    module = importlib.import_module(name)
    points = np.random.default_rng(0).uniform(-1, 1, (40, 3)) + [0, 0, 4]
    xy = points[:, :2] / points[:, 2:] * 500 + [320, 240]
    if name == "pycolmap":
        camera = module.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])
        new = getattr(module, "estimate_and_refine_absolute_pose", None)
        assert (new or module.absolute_pose_estimation)(xy, points, camera)["num_inliers"] == 40
    elif name == "poselib":
        camera = {"model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}
        assert module.estimate_absolute_pose(xy, points, camera, {}, {})[1]["num_inliers"] == 40
    elif name == "torch":
        assert module.linalg.inv(module.eye(300) * 2).sum() == 150
    elif name == "cv2":
        assert module.SIFT_create().detect(np.random.default_rng(0).integers(0, 255, (99, 99), np.uint8), None)
    elif name == "h5py":
        module.File("scene.h5", "w", driver="core", backing_store=False)["x"] = xy

def localize(name):
    """Returns the poses, and checks their form in pycolmap."""
    import colmap_lazyloc as ll
    with ll.Localizer("database.db", "model") as localizer:
        results = sorted(localizer.localize_all(), key=lambda result: result.name)
    assert results and all(result.is_localized for result in results)
    if name == "pycolmap":
        for result in results:
            found = result.as_pycolmap()["cam_from_world"].matrix()
            np.testing.assert_allclose(found, result.cam_from_world, atol=1e-9)
    return [result.pose.bits() for result in results]

def child(name, order, expected):
    if order == "spawn":
        use_other(name)
    assert localize(name) == expected

if __name__ == "__main__":
    name, order = sys.argv[1:]
    if order == "other first":
        use_other(name)
    expected = localize(name)
    use_other(name)
    if order in ("fork", "spawn"):
        process = multiprocessing.get_context(order).Process(target=child, args=(name, order, expected))
        process.start()
        process.join()
        assert process.exitcode == 0, process.exitcode
    assert localize(name) == expected
'''


def write_scene(folder: pathlib.Path) -> None:
    scene = synthetic.make_scene(synthetic.arc(9), synthetic.arc(3, radius=5, height=-0.7, phase=4))
    synthetic.write_database(folder / "database.db", scene)
    synthetic.write_model(folder / "model", scene)
    (folder / "program.py").write_text(PROGRAM)


def try_package(wheel: pathlib.Path, requirement: str, module: str, folder: pathlib.Path) -> list[str]:
    """Returns a description of each failure."""
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--clear", environment], check=True)
    python = environment / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", wheel, requirement], check=True)
    failures = []
    for order in ORDERS:
        done = subprocess.run([python, "program.py", module, order], capture_output=True, text=True, cwd=folder)
        if done.returncode != 0 or done.stderr or done.stdout:
            output = textwrap.indent((done.stdout + done.stderr)[-2000:], "    ")
            failures.append(f"{requirement}, {order}: exit code {done.returncode}\n{output}")
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=pathlib.Path)
    parser.add_argument("requirements", nargs="*", help="as for pip; default: versions of pycolmap")
    options = parser.parse_args()
    modules = {"opencv-python-headless": "cv2"}
    failures = []
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        write_scene(folder)
        for requirement in options.requirements or [f"pycolmap=={version}" for version in PYCOLMAP_VERSIONS]:
            package = requirement.split("==")[0]
            found = try_package(options.wheel.resolve(), requirement, modules.get(package, package), folder)
            print(f"{requirement:24} {'; '.join(ORDERS)}: {'FAILED' if found else 'good'}", flush=True)
            failures += found
    print("\n".join(failures))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

"""Reconstructs folders of photos with COLMAP's defaults, as scenes for `uncertainty stress --data_path`.

Each folder of photos becomes a scene: OUTPUT/NAME/database.db, and OUTPUT/NAME/model, the largest model of COLMAP's
mapper. If masks are beside the photos (FOLDER/../masks, with COLMAP's names), the features keep to them. Leave-one-out
on such a scene tells how the program does on what most users have; errors are relative to the reconstruction itself.

  python -m benchmarks reconstructions --output_path OUTPUT FOLDER... [--max_num_features N] [--colmap COLMAP]
"""

import argparse
import pathlib
import shutil
import tempfile

from colmap_lazyloc.errors import command
from colmap_lazyloc.model import read_model
from colmap_lazyloc.program import find_colmap, gpu_option, run_colmap


def reconstruct(colmap, image_path: pathlib.Path, scene_path: pathlib.Path, max_num_features: int):
    """Makes the scene unless it is there. Returns its model."""
    if not (scene_path / "model").exists():
        scene_path.mkdir(parents=True, exist_ok=True)
        database = "--database_path", scene_path / "database.db"
        images = "--image_path", image_path
        masks = image_path.parent / "masks"
        run_colmap(
            colmap,
            "feature_extractor",
            *database,
            *images,
            *(("--ImageReader.mask_path", masks) if masks.is_dir() else ()),
            "--SiftExtraction.max_num_features",
            max_num_features,
            gpu_option(colmap, "feature_extractor"),
            0,
        )
        run_colmap(colmap, "exhaustive_matcher", *database, gpu_option(colmap, "exhaustive_matcher"), 0)
        with tempfile.TemporaryDirectory(dir=scene_path) as folder:
            run_colmap(colmap, "mapper", *database, *images, "--output_path", folder)
            models = [path for path in pathlib.Path(folder).iterdir() if path.is_dir()]
            largest = max(models, key=lambda path: len(read_model(path).images))
            shutil.move(largest, scene_path / "model")
    return read_model(scene_path / "model")


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=pathlib.Path, metavar="FOLDER", help="folder of photos")
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="folder for the scenes")
    parser.add_argument("--max_num_features", type=int, default=8192, help="of an image; default: COLMAP's, 8192")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    arguments = parser.parse_args(arguments)
    print("| scene | images | registered | cameras |\n|---|---|---|---|")
    for folder in arguments.folders:
        name = folder.resolve().parent.name if folder.name == "images" else folder.resolve().name
        model = reconstruct(arguments.colmap, folder, arguments.output_path / name, arguments.max_num_features)
        num_images = sum(path.is_file() for path in folder.iterdir())
        print(f"| {name} | {num_images} | {len(model.images)} | {len(model.cameras)} |", flush=True)

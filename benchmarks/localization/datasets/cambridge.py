"""Cambridge Landmarks (Kendall et al. 2015), as the University of Cambridge distributes it:

    DATA/ShopFacade/dataset_{train,test}.txt     three lines of heading, then `seq1/frame00001.png X Y Z W P Q R`:
                                                 projection centre and quaternion of cam_from_world
    DATA/ShopFacade/reconstruction.nvm           VisualSFM's cameras: focal length and radial distortion of each image
    DATA/ShopFacade/seq1/frame00001.png          1920 x 1080

With `--ground_truth sfm`, poses, intrinsics and queries come from the models that T. Sattler triangulated again with
COLMAP and that hloc uses. Their intrinsics are for images of 1024 px and are scaled to the dataset's image size:

    DATA/CambridgeLandmarks_Colmap_Retriangulated_1024px/ShopFacade/empty_all/{cameras,images}.txt, list_query.txt
"""

import pathlib

from benchmarks.localization.datasets.formats import image_size, lines_of, pose_of_centre, read_nvm, read_source_images
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage, require
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.text_files import parse_numbers

SCENES = ("GreatCourt", "KingsCollege", "OldHospital", "ShopFacade", "StMarysChurch")
IDS = {
    "KingsCollege": 251342,
    "OldHospital": 251340,
    "StMarysChurch": 251294,
    "ShopFacade": 251336,
    "GreatCourt": 251291,
}
URL = "https://www.repository.cam.ac.uk/bitstream/handle/1810/{id}/{scene}.zip"
BY_HAND = (
    "Cambridge Landmarks is at http://mi.eng.cam.ac.uk/projects/relocalisation/ (for non-commercial use); "
    "unpack each scene's zip, or use --download"
)
SFM_BY_HAND = (
    "get CambridgeLandmarks_Colmap_Retriangulated_1024px.zip as "
    "https://github.com/cvg/Hierarchical-Localization/tree/master/hloc/pipelines/Cambridge says"
)
SFM_FOLDER = "CambridgeLandmarks_Colmap_Retriangulated_1024px"


def archives(scene_name: str) -> dict[str, str]:
    return {URL.format(id=IDS[scene_name], scene=scene_name): "."}


def scene_names(data_path: pathlib.Path) -> list[str]:
    return [name for name in SCENES if (data_path / name / "dataset_train.txt").exists()]


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    scene_path = require(data_path / name, BY_HAND)
    read = _read_sfm if options.ground_truth == "sfm" else _read_original
    images, query_names = read(data_path, scene_path)
    database_names = sorted(set(images) - set(query_names))[:: options.image_step]
    query_names = sorted(query_names)[:: options.image_step]
    kept = {image_name: images[image_name] for image_name in [*database_names, *query_names]}
    return SceneSource(name, scene_path, kept, tuple(query_names))


def _read_original(_, scene_path: pathlib.Path) -> tuple[dict, list[str]]:
    nvm_path = require(scene_path / "reconstruction.nvm", BY_HAND)
    # Ignore the suffix, because the reconstruction was made from JPEG files that are distributed as PNG.
    nvm = {pathlib.PurePosixPath(name).with_suffix(""): camera for name, camera in read_nvm(nvm_path).items()}
    images, poses = {}, {}
    for split in ("train", "test"):
        poses[split] = read_poses(require(scene_path / f"dataset_{split}.txt", BY_HAND))
        for name, pose in poses[split].items():
            nvm_camera = nvm.get(pathlib.PurePosixPath(name).with_suffix(""))
            if nvm_camera is None:
                raise InputError(f"{nvm_path}: has no camera of {name}")
            images[name] = SourceImage(nvm_camera.camera(*image_size(scene_path / name)), pose)
    return images, list(poses["test"])


def _read_sfm(data_path: pathlib.Path, scene_path: pathlib.Path) -> tuple[dict, list[str]]:
    path = require(data_path / SFM_FOLDER / scene_path.name, SFM_BY_HAND)
    images = {
        name: SourceImage(scaled(image.camera, *image_size(scene_path / name)), image.cam_from_world)
        for name, image in read_source_images(require(path / "empty_all", SFM_BY_HAND)).items()
    }
    return images, lines_of(require(path / "list_query.txt", SFM_BY_HAND))


def read_poses(path: pathlib.Path) -> dict:
    """Reads the poses, cam_from_world, by image name."""
    poses = {}
    for line in path.read_text().splitlines()[3:]:
        if line.strip():
            name, values = line.split(maxsplit=1)
            values = parse_numbers(path, values, 7)
            poses[name] = pose_of_centre(values[3:], values[:3])
    return poses


def scaled(camera: Camera, width: int, height: int) -> Camera:
    """Returns the camera for the image scaled to this size."""
    if camera.model != "SIMPLE_RADIAL" or abs(width / camera.width - height / camera.height) > 0.01:
        raise InputError(
            f"{SFM_FOLDER}: cannot scale a {camera.model} camera of {camera.width} x {camera.height} to "
            f"{width} x {height}"
        )
    f, cx, cy, k = camera.params
    x, y = width / camera.width, height / camera.height
    return Camera(camera.model, width, height, (f * x, cx * x, cy * y, k))

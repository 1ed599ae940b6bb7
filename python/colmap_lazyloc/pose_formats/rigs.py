"""Gives poses to all cameras of a rig, if a file has those of one: from rig.json of COLMAP's rig_configurator."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Any

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.conventions import quaternion_rotation
from colmap_lazyloc.pose_formats.posed_images import Photos, PosedImage, PosedImages
from colmap_lazyloc.pose_formats.text import numbers, read_json
from colmap_lazyloc.poses import Pose


@dataclasses.dataclass(frozen=True, eq=False)
class RigCamera:
    """A camera of a rig; without a pose, it is the reference; without a model, its intrinsics are the reference's."""

    cam_from_rig: Pose | None
    model: str | None
    params: tuple[float, ...]


@dataclasses.dataclass(frozen=True, eq=False)
class Rig:
    """The cameras of a rig by the prefix of their photos' names; the reference is the one whose poses a file has."""

    reference: str
    cameras: Mapping[str, RigCamera]

    @staticmethod
    def read(path: pathlib.Path) -> "Rig":
        """Reads a file with one rig."""
        rigs = read_json(path)
        try:
            (rig,) = rigs
            (reference,) = (entry["image_prefix"] for entry in rig["cameras"] if entry.get("ref_sensor"))
            return Rig(reference, {entry["image_prefix"]: _read_camera(entry) for entry in rig["cameras"]})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"--rig_config_path {path}: is not one rig with one ref_sensor: {error}") from None

    def add_cameras(self, posed: PosedImages, photos: Photos) -> PosedImages:
        """Adds the images of the other cameras, whose names differ in the prefix only; they must exist as photos."""
        names, images = set(photos.names), []
        for image in posed.images:
            for prefix, camera in self.cameras.items():
                name = prefix + image.name.removeprefix(self.reference)
                if name in names:
                    own, pose = image.camera, image.cam_from_world
                    if camera.model is not None:
                        own = Camera(camera.model, *photos.size(name), camera.params)
                    if camera.cam_from_rig is not None:
                        pose = camera.cam_from_rig @ pose
                    images.append(PosedImage(name, own, pose))
        for prefix in self.cameras:
            if not any(image.name.startswith(prefix) for image in images):
                logger.warning("camera %s of the rig has no photo beside one of %s", prefix, self.reference)
        return dataclasses.replace(posed, images=images)


def _read_camera(entry: Mapping[str, Any]) -> RigCamera:
    pose = None
    if ("camera_model_name" in entry) != ("camera_params" in entry):
        raise ValueError("a camera has camera_model_name or camera_params, but both are needed")
    if not entry.get("ref_sensor"):
        rotation = quaternion_rotation(numbers(entry["cam_from_rig_rotation"], 4))
        pose = Pose.from_matrix(rotation, numbers(entry["cam_from_rig_translation"], 3))
    return RigCamera(pose, entry.get("camera_model_name"), tuple(map(float, entry.get("camera_params", ()))))

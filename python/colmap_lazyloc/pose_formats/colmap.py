"""Reads a COLMAP model, text or binary; its poses keep every bit."""

from colmap_lazyloc.model import read_model
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages, Source


def read(source: Source) -> PosedImages:
    model = read_model(source.path)
    images = []
    for image in model.images.values():
        name = source.find_photo(image.name)
        if name is not None and image.cam_from_world is not None:
            images.append(PosedImage(name, source.camera or model.cameras[image.camera_id], image.cam_from_world))
    return PosedImages(images, GeoOrigin.read(source.path))

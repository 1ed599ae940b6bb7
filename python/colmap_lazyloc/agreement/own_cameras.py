"""Reconstructions in which each photo has a camera of its own, although one camera took all photos."""

from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.model import num_focal_lengths
from colmap_lazyloc.pose_formats.posed_images import PosedImage

MIN_NUM_IMAGES = 5
MIN_SPREAD, MAX_SPREAD = 0.001, 0.15  # of the middle half of the focal lengths: below is rounding, above is a zoom
MAX_OFFSET_PX = 1.0  # of a principal point that nobody estimated from the middle of the photo; undistortion rounds


def own_cameras(images: Sequence[PosedImage]) -> str:
    """Returns a line if COLMAP's mapper has estimated a focal length for each photo; empty if not.

    COLMAP gives photos without EXIF a camera each, unless `--ImageReader.single_camera` is given. The mapper leaves
    their principal points in the middle.
    """
    cameras = {image.camera for image in images}
    models = {camera.model for camera in cameras}
    if len(images) < MIN_NUM_IMAGES or len(cameras) < len(images) or len(models) > 1 or "EQUIRECTANGULAR" in models:
        return ""
    num = num_focal_lengths(images[0].camera.model)
    middles = np.array([[camera.width / 2, camera.height / 2] for camera in cameras])
    if np.abs(np.array([camera.params[num : num + 2] for camera in cameras]) - middles).max() > MAX_OFFSET_PX:
        return ""
    least, most = np.percentile([np.mean(camera.params[:num]) for camera in cameras], [25, 75])
    if not MIN_SPREAD <= most / least - 1 <= MAX_SPREAD:
        return ""
    return (
        f"each of the {len(images)} images has a camera of its own (half of their focal lengths are from {least:.0f} "
        f"to {most:.0f} px): if one camera without zoom took them, poses are usually better if you reconstruct with "
        "--ImageReader.single_camera 1"
    )

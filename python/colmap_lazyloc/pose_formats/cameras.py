"""Makes COLMAP's cameras from the coefficients of other programs."""

from colmap_lazyloc.model import Camera


def brown_camera(
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: tuple[float, ...] = (),
    tangential: tuple[float, float] = (0.0, 0.0),
) -> Camera:
    """Returns a camera with Brown's distortion: k1, k2, k3 and p1, p2 in OpenCV's order. Pixels are COLMAP's."""
    k1, k2, k3, *rest = (*radial, 0.0, 0.0, 0.0)
    if any(rest):
        raise ValueError("a camera has a coefficient k4, which COLMAP's camera models lack: calibrate it with k1 to k3")
    pinhole = (*focal, *centre)
    if k3 != 0:
        return Camera("FULL_OPENCV", *size, (*pinhole, k1, k2, *tangential, k3, 0.0, 0.0, 0.0))
    if any((k1, k2, *tangential)):
        return Camera("OPENCV", *size, (*pinhole, k1, k2, *tangential))
    return Camera("PINHOLE", *size, pinhole)


def fisheye_camera(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], radial: tuple[float, ...] = ()
) -> Camera:
    """Returns an equidistant camera: k1 to k4 in OpenCV's order."""
    k1, k2, k3, k4 = (*radial, 0.0, 0.0, 0.0, 0.0)[:4]
    return Camera("OPENCV_FISHEYE", *size, (*focal, *centre, k1, k2, k3, k4))

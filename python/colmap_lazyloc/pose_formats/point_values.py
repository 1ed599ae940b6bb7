"""What is known of a photo beside its place: the values of its point on a map, for formats that take any values."""

import numpy as np

from colmap_lazyloc.pose_formats.raw_poses import RawPose

STDDEVS = ("stddev_east_m", "stddev_north_m", "stddev_up_m")
NAMES = (
    *("status", "confidence", "height_m", "heading_deg", "pitch_deg", "roll_deg"),
    *(*STDDEVS, "heading_stddev_deg", "top_heading_deg"),
)


def values_of(pose: RawPose) -> dict[str, float | str | None]:
    """Returns the values by name, in the order of NAMES; None for an unknown one. The vector of the pose must be
    longitude, latitude and height, and its rotation heading, pitch and roll."""
    heading, pitch, roll = map(float, pose.rotation)
    values: dict[str, float | str | None] = dict.fromkeys(NAMES)
    values |= {"status": "DATABASE", "height_m": float(pose.vector[2])}
    values |= {"heading_deg": heading % 360, "pitch_deg": pitch, "roll_deg": roll}
    if pose.result is not None:
        covariance = pose.result.get("position_covariance")
        if covariance is not None:
            values |= dict(zip(STDDEVS, np.sqrt(np.diag(covariance)).tolist()))
        values |= {"status": pose.result["status"], "confidence": pose.result.get("confidence")}
        values |= {"heading_stddev_deg": pose.result.get("heading_stddev_deg")}
        values |= {"top_heading_deg": pose.result.get("top_heading_deg")}
    return values

"""The result of a query."""

import dataclasses
import html
import json
from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.poses import Pose
from colmap_lazyloc.result_fields import ResultFields
from colmap_lazyloc.results import to_pose

if TYPE_CHECKING:
    import pycolmap


class PycolmapPose(TypedDict):
    """What pycolmap's estimators of absolute poses return, and the covariance."""

    cam_from_world: "pycolmap.Rigid3d"
    num_inliers: int
    inlier_mask: NDArray[np.bool_]
    covariance: NDArray[np.float64] | None


@dataclasses.dataclass(frozen=True)
class RunnerUp:
    """The most probable other explanation of the images that has a pose."""

    explanation: str  # what is right if it is, in words
    pose: Pose
    odds: float | None  # over the result's pose; None if the result's confidence is 0


class Result:
    """What the localizer reports of a query: a status, and a pose if the images determine one.

    Poses are cam_from_world, x_cam = R x_world + t, in COLMAP's camera frame (x right, y down, z forward). Lengths are
    in the model's unit, pixels follow COLMAP's convention: the centre of the upper-left pixel is (0.5, 0.5).
    """

    __slots__ = ("_fields", "keypoints", "line", "name", "observations", "point_keypoints", "points")

    name: str  # of the query
    line: str  # the line of results.jsonl
    keypoints: NDArray[np.float64]  # of the query, n x 2, xy in pixels
    points: NDArray[np.float64]  # points that the query observes, m x 3, in world coordinates
    point_keypoints: NDArray[np.int32]  # m: the keypoint that observes each point
    observations: NDArray[np.int32]  # k x 3: a point, an index into `pairs` of as_dict(), its image's keypoint

    def __init__(
        self,
        name: str,
        line: str,
        keypoints: NDArray[np.float64],
        points: NDArray[np.float64],
        point_keypoints: NDArray[np.int32],
        observations: NDArray[np.int32],
    ):
        self.name = name
        self.observations = observations
        self.line, self.keypoints, self.points, self.point_keypoints = line, keypoints, points, point_keypoints
        self._fields: ResultFields = json.loads(line)

    @property
    def status(self) -> str:
        """Returns "LOCALIZED", or why the query has no pose to rely on, for example "NO_PAIRS"."""
        return self._fields["status"]

    @property
    def is_localized(self) -> bool:
        """True if the status is LOCALIZED, so that there is a pose."""
        return self.status == "LOCALIZED"

    @property
    def reason(self) -> str:
        """Returns one sentence about the status; empty for a localized query."""
        return self._fields["reason"]

    @property
    def confidence(self) -> float | None:
        """Returns the probability that the position is right, from 0 to 1; None if there is no pose to judge."""
        return self._fields["confidence"]

    @property
    def runner_up(self) -> RunnerUp | None:
        """Returns the most probable other explanation with its `pose`, its `explanation` in words and its `odds` over
        the result's pose (docs/formats.md); None if nothing competes."""
        fields = self._fields.get("runner_up")
        if fields is None:
            return None
        cam_from_world = fields["cam_from_world"]
        pose = Pose(np.array(cam_from_world["qvec"], float), np.array(cam_from_world["tvec"], float))
        return RunnerUp(fields["explanation"], pose, fields["odds"])

    @property
    def pose(self) -> Pose | None:
        """Returns the pose with the bits of poses.txt (quaternion and translation); None without LOCALIZED."""
        return to_pose(self._fields["cam_from_world"])

    @property
    def cam_from_world(self) -> NDArray[np.float64] | None:
        """Returns the pose as a 3x4 matrix [R | t]; None without LOCALIZED."""
        return _to_matrix(self.pose)

    @property
    def position(self) -> NDArray[np.float64] | None:
        """Returns the camera's centre in world coordinates, x y z; None without LOCALIZED."""
        return _to_array(self._fields["position"])

    @property
    def unconfirmed_cam_from_world(self) -> NDArray[np.float64] | None:
        """Returns the pose of a query with the status LOW_CONFIDENCE as a 3x4 matrix; None for any other status."""
        return _to_matrix(to_pose(self._fields["unconfirmed_cam_from_world"]))

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Returns the 6x6 covariance of the pose: rotation w in rad (R <- exp(w) R), then t; None if unknown."""
        return _to_array(self._fields["covariance"])

    @property
    def world_from_cam(self) -> NDArray[np.float64] | None:
        """Returns the camera's pose in the map as a 3x4 matrix [R | C]: its axes, and its centre; None without
        LOCALIZED."""
        return _to_matrix(to_pose(self._fields["world_from_cam"]))

    @property
    def position_covariance(self) -> NDArray[np.float64] | None:
        """Returns the 3x3 covariance of `position` along the axes of the map, in the model's unit squared; None if
        unknown."""
        return _to_array(self._fields["position_covariance"])

    @property
    def pose_covariance_in_map(self) -> NDArray[np.float64] | None:
        """Returns the 6x6 covariance of world_from_cam in the order of ROS' PoseWithCovariance: position, then rotation
        about the fixed axes of the map in rad (R <- exp(turn) R for R of world_from_cam); None if unknown."""
        return _to_array(self._fields["pose_covariance_in_map"])

    @property
    def heading_deg(self) -> float | None:
        """Returns where the optical axis points over the ground, clockwise from true north if the model is geographic,
        else from +y of the model (z is up), from 0 to 360; None without LOCALIZED. Looking straight up or down, an axis
        has no heading: see top_heading_deg."""
        return self._fields["heading_deg"]

    @property
    def pitch_deg(self) -> float | None:
        """Returns the angle of the optical axis above the horizon, from -90 to 90; None without LOCALIZED."""
        return self._fields["pitch_deg"]

    @property
    def roll_deg(self) -> float | None:
        """Returns the rotation about the optical axis, from -180 to 180, positive if the photo's right side is lower;
        None without LOCALIZED."""
        return self._fields["roll_deg"]

    @property
    def top_heading_deg(self) -> float | None:
        """Returns where the top of the photo points over the ground, as heading_deg; None without LOCALIZED. Of a photo
        that looks down, this is the heading of the drone."""
        return self._fields["top_heading_deg"]

    @property
    def heading_stddev_deg(self) -> float | None:
        """Returns the standard deviation of heading_deg, at most 104, that of an unknown direction; None if unknown."""
        return self._fields["heading_stddev_deg"]

    @property
    def pitch_stddev_deg(self) -> float | None:
        """Returns the standard deviation of pitch_deg; None if unknown."""
        return self._fields["pitch_stddev_deg"]

    @property
    def roll_stddev_deg(self) -> float | None:
        """Returns the standard deviation of roll_deg, at most 104; None if unknown."""
        return self._fields["roll_stddev_deg"]

    @property
    def top_heading_stddev_deg(self) -> float | None:
        """Returns the standard deviation of top_heading_deg, at most 104; None if unknown."""
        return self._fields["top_heading_stddev_deg"]

    @property
    def inlier_mask(self) -> NDArray[np.bool_]:
        """Returns n values: True for each keypoint of the query that observes a point of the result."""
        mask = np.zeros(len(self.keypoints), np.bool_)
        mask[self.point_keypoints] = True
        return mask

    @property
    def num_inliers(self) -> int:
        """Returns the number of keypoints that observe a point of the result."""
        return int(np.count_nonzero(self.inlier_mask))

    def as_dict(self) -> ResultFields:
        """Returns the fields of the line of results.jsonl (docs/formats.md)."""
        fields: ResultFields = json.loads(self.line)
        return fields

    def as_pycolmap(self) -> PycolmapPose | None:
        """Returns the dict of pycolmap's estimators of absolute poses: cam_from_world (pycolmap.Rigid3d), num_inliers,
        inlier_mask and covariance; None without LOCALIZED, as these estimators do. Needs pycolmap."""
        pose = self.pose
        if pose is None:
            return None
        from colmap_lazyloc.pycolmap_types import to_rigid3d

        return {
            "cam_from_world": to_rigid3d(pose),
            "num_inliers": self.num_inliers,
            "inlier_mask": self.inlier_mask,
            "covariance": self.covariance,
        }

    def __repr__(self) -> str:
        has_confidence = self.is_localized and self.confidence is not None
        detail = f"confidence {self.confidence:.3g}" if has_confidence else self.reason
        return f"<Result {self.name}: {self.status}{', ' if detail else ''}{detail}>"

    def _repr_html_(self) -> str:
        """Returns a table for notebooks: status, confidence, and the position with its standard deviations."""
        rows = [("query", self.name), ("status", self.status), ("reason", self.reason)]
        if self.confidence is not None:
            rows.append(("confidence", f"{self.confidence:.3g}"))
        if self.position is not None:
            rows.append(("position", ", ".join(f"{coordinate:.6g}" for coordinate in self.position)))
            stddevs = self._fields["position_stddevs"]
            rows.append(("standard deviations", "" if stddevs is None else ", ".join(f"{s:.2g}" for s in stddevs)))
            rows.append(("points", str(len(self.points))))
        cells = (f"<tr><th>{label}</th><td>{html.escape(text)}</td></tr>" for label, text in rows if text)
        return f"<table>{''.join(cells)}</table>"


def _to_array(numbers: list[float] | list[list[float]] | None) -> NDArray[np.float64] | None:
    return None if numbers is None else np.array(numbers, np.float64)


def _to_matrix(pose: Pose | None) -> NDArray[np.float64] | None:
    return None if pose is None else np.column_stack([pose.rotation, pose.tvec])

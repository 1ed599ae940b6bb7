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
    """A dict with the keys that pycolmap's absolute pose estimators return, and `covariance` (as in `Result`)."""

    cam_from_world: "pycolmap.Rigid3d"
    num_inliers: int
    inlier_mask: NDArray[np.bool_]
    covariance: NDArray[np.float64] | None


@dataclasses.dataclass(frozen=True)
class RunnerUp:
    """The most probable alternative to the pose of a result."""

    explanation: str  # what supports the alternative, in words
    pose: Pose
    odds: float | None  # its probability divided by the pose's probability; None if the result's confidence is 0


class Result:
    """The result for a query: a status, and a pose if the images determine the pose.

    Poses are cam_from_world, x_cam = R x_world + t, in COLMAP's camera frame (x right, y down, z forward). Lengths are
    in the model's unit. As in COLMAP, the centre of the upper-left pixel is (0.5, 0.5).
    """

    __slots__ = ("_fields", "keypoints", "line", "name", "observations", "point_keypoints", "points")

    name: str  # name of the query
    line: str  # the query's line in results.jsonl
    keypoints: NDArray[np.float64]  # keypoints of the query, n x 2, x and y in pixels
    points: NDArray[np.float64]  # 3D points that the query observes, m x 3, in world coordinates
    point_keypoints: NDArray[np.int32]  # for each point, the index of the query keypoint that observes it
    observations: NDArray[np.int32]  # k x 3; indices of a point, a pair in as_dict(), a keypoint of its database image

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
        """Returns "LOCALIZED", or the reason why there is no reliable pose, for example "NO_PAIRS"."""
        return self._fields["status"]

    @property
    def is_localized(self) -> bool:
        """True if the status is LOCALIZED. The result then has a pose."""
        return self.status == "LOCALIZED"

    @property
    def reason(self) -> str:
        """Returns one sentence that explains the status; empty if the query is localized."""
        return self._fields["reason"]

    @property
    def confidence(self) -> float | None:
        """Returns the probability that the position is right, from 0 to 1; None if no pose was found."""
        return self._fields["confidence"]

    @property
    def runner_up(self) -> RunnerUp | None:
        """Returns the most probable alternative to the result's pose, or None. It has a `pose`, an `explanation` in
        words, and `odds`: its probability, divided by the probability of the result's pose."""
        fields = self._fields.get("runner_up")
        if fields is None:
            return None
        cam_from_world = fields["cam_from_world"]
        pose = Pose(np.array(cam_from_world["qvec"], float), np.array(cam_from_world["tvec"], float))
        return RunnerUp(fields["explanation"], pose, fields["odds"])

    @property
    def pose(self) -> Pose | None:
        """Returns the pose exactly as in poses.txt (quaternion and translation); None unless LOCALIZED."""
        return to_pose(self._fields["cam_from_world"])

    @property
    def cam_from_world(self) -> NDArray[np.float64] | None:
        """Returns the pose as a 3x4 matrix [R | t]; None unless LOCALIZED."""
        return _to_matrix(self.pose)

    @property
    def position(self) -> NDArray[np.float64] | None:
        """Returns the camera's centre in world coordinates, x y z; None unless LOCALIZED."""
        return _to_array(self._fields["position"])

    @property
    def unconfirmed_cam_from_world(self) -> NDArray[np.float64] | None:
        """Returns the pose of a LOW_CONFIDENCE query as a 3x4 matrix; None for any other status."""
        return _to_matrix(to_pose(self._fields["unconfirmed_cam_from_world"]))

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Returns the 6x6 covariance of cam_from_world: first the rotation w in rad (R <- exp(w) R), then the
        translation t. None if unknown."""
        return _to_array(self._fields["covariance"])

    @property
    def world_from_cam(self) -> NDArray[np.float64] | None:
        """Returns the camera's pose in the world as a 3x4 matrix [R | C]: the columns of R are the camera's axes, and C
        is the camera's centre; None unless LOCALIZED."""
        return _to_matrix(to_pose(self._fields["world_from_cam"]))

    @property
    def position_covariance(self) -> NDArray[np.float64] | None:
        """Returns the 3x3 covariance of `position` in world coordinates, in the square of the model's unit; None if
        unknown."""
        return _to_array(self._fields["position_covariance"])

    @property
    def pose_covariance_in_map(self) -> NDArray[np.float64] | None:
        """Returns the 6x6 covariance of world_from_cam, in the order of ROS's PoseWithCovariance: first the position,
        then the rotation w in rad about the fixed axes of the world (R <- exp(w) R for the rotation R of
        world_from_cam). None if unknown."""
        return _to_array(self._fields["pose_covariance_in_map"])

    @property
    def heading_deg(self) -> float | None:
        """Returns the compass direction of the optical axis, from 0 to 360: 0 is north, 90 is east. In a model without
        geographic coordinates, north is +y, and up is +z. None if the query is not localized, or if no axis of the
        model is known to point up. For a camera that looks straight up or down, use top_heading_deg."""
        return self._fields["heading_deg"]

    @property
    def pitch_deg(self) -> float | None:
        """Returns the angle of the optical axis above the horizon, from -90 to 90; None if heading_deg is None."""
        return self._fields["pitch_deg"]

    @property
    def roll_deg(self) -> float | None:
        """Returns the rotation about the optical axis, from -180 to 180, positive if the photo's right side is lower;
        None if heading_deg is None."""
        return self._fields["roll_deg"]

    @property
    def top_heading_deg(self) -> float | None:
        """Returns the compass direction from the centre of the photo to its top edge, seen from above: 0 is north, 90
        is east; None if heading_deg is None. If a drone's camera looks down, this is usually the heading of the
        drone."""
        return self._fields["top_heading_deg"]

    @property
    def heading_stddev_deg(self) -> float | None:
        """Returns the standard deviation of heading_deg; None if unknown; 104 degrees if every direction is
        possible."""
        return self._fields["heading_stddev_deg"]

    @property
    def pitch_stddev_deg(self) -> float | None:
        """Returns the standard deviation of pitch_deg; None if unknown."""
        return self._fields["pitch_stddev_deg"]

    @property
    def roll_stddev_deg(self) -> float | None:
        """Returns the standard deviation of roll_deg; None if unknown; 104 degrees if every angle is possible."""
        return self._fields["roll_stddev_deg"]

    @property
    def top_heading_stddev_deg(self) -> float | None:
        """Returns the standard deviation of top_heading_deg; None if unknown; 104 degrees if every direction is
        possible."""
        return self._fields["top_heading_stddev_deg"]

    @property
    def inlier_mask(self) -> NDArray[np.bool_]:
        """Returns, for each keypoint of the query, whether it observes a point in `points`."""
        mask = np.zeros(len(self.keypoints), np.bool_)
        mask[self.point_keypoints] = True
        return mask

    @property
    def num_inliers(self) -> int:
        """Returns the number of keypoints that observe a point in `points`."""
        return int(np.count_nonzero(self.inlier_mask))

    def as_dict(self) -> ResultFields:
        """Returns the fields of the query's line in results.jsonl (docs/formats.md)."""
        fields: ResultFields = json.loads(self.line)
        return fields

    def as_pycolmap(self) -> PycolmapPose | None:
        """Returns a dict as pycolmap's absolute pose estimators do (cam_from_world as a pycolmap.Rigid3d, num_inliers,
        inlier_mask), with the covariance; None if there is no pose. Needs pycolmap."""
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

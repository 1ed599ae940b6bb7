"""The types of what `colmap lazy_localizer` writes: a line of results.jsonl, and leave_one_out.json.

docs/formats.md explains what the fields mean. A value that is NotRequired is in the file only in some cases; runs of
older versions may lack others.
"""

from typing import NotRequired, TypedDict


class PoseFields(TypedDict):
    """A pose."""

    qvec: list[float]  # w, x, y, z
    tvec: list[float]


class CameraFields(TypedDict):
    """Intrinsics: COLMAP's camera model and its parameters."""

    model: str
    width: int
    height: int
    params: list[float]


class PairFields(TypedDict):
    """A database image that was compared with the query."""

    name: str
    num_inliers: int
    rotation_error_deg: float | None
    direction_error_deg: float | None


# The line on which a query is whose position is not determined. A class cannot have a field `from`.
BearingFields = TypedDict("BearingFields", {"from": str, "direction": list[float], "stddev_deg": float})


class EvidenceFields(TypedDict):
    """The values from which the confidence is computed."""

    num_common_tracks: float | None
    num_single_tracks: float | None
    explained_ratio: float | None
    competing_ratio: float | None
    median_error_px: float | None
    position_stddev_ratio: float | None
    scene_distance: float | None


class IntrinsicsFields(TypedDict):
    """The result of the test whether the images agree with the query's intrinsics."""

    origin: str
    verdict: str
    focal_factor: float | None
    focal_factor_stddev: float | None
    contradiction: str | None
    covariance: NotRequired[list[list[float]]]


class PoseNoiseFields(TypedDict):
    """The expected sizes of the errors of the database poses."""

    source: str
    num_pairs: int
    viewpoint_px: float | None
    rotation_px: float | None
    position_px: float | None


class DepthMapFields(TypedDict):
    """How the depth map of a database image was used."""

    name: str
    verdict: str
    num_points: int
    depth_stddev_ratio: float | None
    scale: float | None
    scale_stddev_ratio: float | None


class DepthFields(TypedDict):
    """How depth maps of database images were used."""

    fixes: str
    num_points: int
    maps: list[DepthMapFields]


class PriorFields(TypedDict):
    """How a position or a direction of gravity was used."""

    verdict: str
    fixes: str
    deviation: float | None
    deviation_sigma: float | None


class PriorsFields(TypedDict):
    """How the query's position and direction of gravity were used."""

    position: PriorFields | None
    gravity: PriorFields | None


class RunnerUpFields(TypedDict):
    """The most probable alternative to the pose."""

    explanation: str
    odds: float | None
    cam_from_world: PoseFields
    position: list[float]


class EpochFields(TypedDict):
    """How the pose of the query has changed when all new photos were adjusted together (`--epoch`)."""

    hangs_on: str
    is_adjusted: bool
    shift: float


class ResultFields(TypedDict):
    """A line of results.jsonl: the result for one query."""

    name: str
    status: str
    reason: str
    start: str
    confidence: float | None
    evidence: EvidenceFields | None
    runner_up: NotRequired[RunnerUpFields]
    epoch: NotRequired[EpochFields]
    cam_from_world: PoseFields | None
    unconfirmed_cam_from_world: PoseFields | None
    covariance: list[list[float]] | None
    position: list[float] | None
    position_stddevs: list[float] | None
    weakest_direction: list[float] | None
    rotation_stddev_deg: float | None
    rotation: list[float] | None
    bearing: BearingFields | None
    world_from_cam: PoseFields | None
    position_covariance: list[list[float]] | None
    pose_covariance_in_map: list[list[float]] | None
    heading_deg: float | None
    heading_stddev_deg: float | None
    pitch_deg: float | None
    pitch_stddev_deg: float | None
    roll_deg: float | None
    roll_stddev_deg: float | None
    top_heading_deg: float | None
    top_heading_stddev_deg: float | None
    frame: str | None
    rig_from_world: PoseFields | None
    rig_scale: NotRequired[float]
    rig_error_px: float | None
    camera: NotRequired[CameraFields]
    database_pose_noise: NotRequired[PoseNoiseFields]
    depth: NotRequired[DepthFields]
    intrinsics: IntrinsicsFields
    intrinsics_source: str | None
    matching_type: NotRequired[str]
    priors: NotRequired[PriorsFields]
    num_tracks: int
    num_observations: int
    mean_reprojection_error_px: float | None
    pairs: list[PairFields]
    damaged_records: NotRequired[list[str]]
    seconds: dict[str, float]


class RiskCoverageFields(TypedDict):
    """A minimum confidence, the share of queries with at least this confidence, and the share of wrong poses among
    these queries."""

    confidence: float
    coverage: float
    risk: float


class LeaveOneOutPose(TypedDict):
    """An entry of the list `poses` in leave_one_out.json: the errors of a query that has a pose."""

    name: str
    confidence: float
    is_accepted: bool
    is_wrong: bool
    position_error: float
    position_error_sigma: float
    rotation_error_deg: float


class LeaveOneOutFields(TypedDict):
    """The content of leave_one_out.json."""

    num_queries: int
    num_by_status: dict[str, int]
    scene_size: float
    median_position_error: float | None
    median_position_error_sigma: float | None
    median_rotation_error_deg: float | None
    num_accepted: int
    num_accepted_and_wrong: int
    auroc: float | None
    risk_coverage: list[RiskCoverageFields]
    poses: list[LeaveOneOutPose]

"""Files of estimated poses, `name qw qx qy qz tx ty tz` (cam_from_world) a line."""

import pathlib

from geometry import Pose


def write_poses(path: pathlib.Path, poses: dict[str, Pose]):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{name} {_pose_text(pose)}\n" for name, pose in sorted(poses.items())))


def write_submission(path: pathlib.Path, poses: dict[str, Pose]):
    """As visuallocalization.net takes them for Aachen Day-Night: names without their folders."""
    names = {name: pathlib.PurePosixPath(name).name for name in poses}
    if len(set(names.values())) < len(names):
        raise ValueError(f"{path}: two queries have the same name in different folders")
    write_poses(path, {names[name]: pose for name, pose in poses.items()})


def _pose_text(pose: Pose) -> str:
    return " ".join(f"{value:.17g}" for value in [*pose.qvec(), *pose.translation])

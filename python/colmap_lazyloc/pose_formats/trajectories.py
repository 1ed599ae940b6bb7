"""Reads and writes trajectories: tables and lists of poses whose photos are found by time, number or order.

They give the poses of a body, world_from_body. The body is the camera itself, unless a calibration gives the camera's
pose on the body.
"""

import dataclasses
import pathlib
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.pose_formats.conventions import Convention
from colmap_lazyloc.pose_formats.naming import last_number, natural_key, times_of
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, matrix_parts
from colmap_lazyloc.pose_formats.table import CAMERA_COLUMNS, NAME, QUATERNION, camera_of_row, quaternion_columns
from colmap_lazyloc.pose_formats.text import Names, Row, Table, numbers, read_numbers, words
from colmap_lazyloc.text_files import read_entries

MATRIX = tuple(f"t{row}{column}" for row in range(3) for column in range(4))
LAST_ROW = "t30 t31 t32 t33"
TIME = ("timestamp", "time", "t")
FRAME = ("frame", "frameid", "id")
CENTRE = (("x", "tx", "px", "prsrx"), ("y", "ty", "py", "prsry"), ("z", "tz", "pz", "prsrz"))
EXPECTED = "timestamp, frame or name; x, y, z; qw, qx, qy, qz, or a matrix t_00 to t_23"
# The columns of files without their names.
TUM = ("time x y z qx qy qz qw",)
KITTI = (" ".join(MATRIX),)
KITTI360 = (f"frame {KITTI[0]}", f"frame {KITTI[0]} {LAST_ROW}")
RTABMAP = ("time x y z qx qy qz qw id",)
ARKIT = ("time x y z qw qx qy qz", f"time {KITTI[0]}")
ARCORE = ("time qx qy qz qw x y z",)
# Columns of EuRoC's ground truth that are no poses: velocities and biases of the body.
VELOCITIES = tuple(f"{name}{axis}" for name in ("vrsr", "bwrss", "barss") for axis in "xyz")
STRAY_SCANNER = {"timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw"}


def parse(source: Source, layouts: Sequence[str], convention: Convention, takes_names: bool = True) -> RawPoses:
    """Reads a table by the names of its columns, or by a layout if it has none."""
    table = Table(source.path, layouts)
    if table.has(NAME) and not takes_names:
        raise InputError(f"{source.path}: has a column with names, so that it is no trajectory: give csv or poses")
    if not (takes_names or table.has_names) and table.separator == "," and source.quaternion_order is None:
        raise InputError(
            f"{source.path}: has neither names of columns nor blanks between them, as TUM's files have: their "
            "quaternions begin or end with w: give --quaternion_order wxyz or xyzw"
        )
    matrix, quaternion = _matrix_columns(table), QUATERNION
    if table.has("qrsw"):  # EuRoC
        quaternion = ("qrsw", "qrsx", "qrsy", "qrsz")
    if matrix is None:
        table.require(EXPECTED, *CENTRE, *quaternion)
        columns, convention = quaternion_columns(table, convention, quaternion)
    else:
        columns, convention = matrix, dataclasses.replace(convention, rotation="matrix")
    if set(table.columns) >= STRAY_SCANNER:
        convention = dataclasses.replace(convention, camera_axes="opencv")
    keys = [table.has(names) for names in (NAME, FRAME, TIME)]

    def parse_row(row: Row) -> RawPose:
        values = row.numbers(*columns)
        turn, vector = (values, row.numbers(*CENTRE)) if matrix is None else matrix_parts(values)
        return RawPose(
            turn,
            vector,
            row.text(NAME) if keys[0] else None,
            int(row.number(FRAME)) if keys[1] else None,
            row.number(TIME) if keys[2] else None,
            camera_of_row(row),
        )

    poses = each(table.rows(), parse_row, lambda row: row.label)
    table.report_unused(CAMERA_COLUMNS.union(LAST_ROW.split(), VELOCITIES))
    return RawPoses(poses, convention=convention)


def _matrix_columns(table: Table) -> tuple[Names, ...] | None:
    names: tuple[Names, ...] = tuple((name, name.replace("t", "m"), name.replace("t", "r")) for name in MATRIX)
    return names if table.has(*names) else None


def parse_of_body(source: Source, layouts: Sequence[str], convention: Convention) -> RawPoses:
    """Reads poses of a robot or of an inertial unit, which determine no camera without a calibration.

    Poses of cameras have files with other names: cam0_to_world.txt of KITTI-360, ..._camera_poses.txt of RTAB-Map.
    """
    is_camera = source.calibration_path is not None or source.camera_axes is not None
    if not is_camera and "cam" not in source.path.name.lower():
        raise InputError(
            f"{source.path}: its poses are of the body: give --calibration, which says how the camera is "
            "mounted, or --camera_axes opencv if the poses are of the camera"
        )
    return parse(source, layouts, convention)


def parse_matrices(source: Source) -> RawPoses:
    """Reads 4x4 matrices: one in each line, one in each four lines, or one in each text file of a folder."""
    if source.path.is_dir():
        paths = sorted(path for path in source.path.iterdir() if path.suffix == ".txt")
        return RawPoses(each(paths, _read_matrix, lambda path: path.name))
    rows = [line.replace(",", " ").split() for _, line in read_entries(source.path)]
    if all(len(row) == 4 for row in rows if len(row) != 3):  # Open3D writes three whole numbers before each matrix
        rows = [row for row in rows if len(row) != 3]
        rows = [[word for row in rows[start : start + 4] for word in row] for start in range(0, len(rows), 4)]
    return RawPoses(each(rows, lambda row: RawPose(*matrix_parts(numbers(row, 16)))))


def _read_matrix(path: pathlib.Path) -> RawPose:
    number = last_number(path.name)
    matrix = matrix_parts(read_numbers(path, 16))
    return RawPose(*matrix, name=path.stem) if number is None else RawPose(*matrix, frame=int(float(number)))


def tum_text(raw: RawPoses) -> str:
    """Returns lines `timestamp tx ty tz qx qy qz qw`, by their times."""
    poses = {pose.name: pose for pose in raw.written if pose.name is not None}
    times = times_of(poses)
    warn_of_numbers(times)
    lines = ["# timestamp tx ty tz qx qy qz qw: poses world_from_cam of the localized queries"]
    lines += [f"{time} {words(poses[name].vector, poses[name].rotation)}" for time, name in times]
    return "\n".join(lines) + "\n"


def warn_of_numbers(times: Sequence[tuple[str, str]]) -> None:
    """Says so if the times of names are no parts of these."""
    if any(time not in name for time, name in times):
        logger.warning("times are 0, 1, 2, ... in the order of the names, because the numbers in these are not unique")


def kitti_text(raw: RawPoses) -> str:
    """Returns a 3 x 4 matrix per line, in the order of the names, 2 before 10."""
    poses = sorted(raw.written, key=lambda pose: natural_key(pose.name or ""))
    return "".join(f"{words(np.column_stack([pose.rotation, pose.vector]))}\n" for pose in poses)

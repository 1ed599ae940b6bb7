"""Localizes the images of a database along a trajectory from odometry or SLAM, five at a time.

    python localize_trajectory.py database.db model odometry.txt

`odometry.txt` has a line `name qw qx qy qz tx ty tz` per image: cam_from_world in the odometry's own world and unit.
Within five images odometry hardly drifts, so that each five are one rigid body of unknown pose and scale.
"""

import sys

import colmap_lazyloc as ll
from colmap_lazyloc.poses import read_poses

database, model, odometry_path = sys.argv[1:]
odometry = read_poses(odometry_path)
names = sorted(odometry)
with ll.Localizer(database, model) as localizer:
    for start in range(0, len(names), 5):
        window = {name: odometry[name] for name in names[start : start + 5]}
        for name, result in localizer.localize_trajectory(window, has_scale=False).items():
            print(name, result.status, "" if result.pose is None else result.pose.text())

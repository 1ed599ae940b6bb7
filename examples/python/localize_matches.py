"""Localizes a query from features and matches of any kind: no database, no 3D map.

    python localize_matches.py matches.npz

`matches.npz` has the arrays `keypoints` (n x 2 pixels of the query), `camera` (fx, fy, cx, cy, width, height, of all
images), and for each posed image NAME: `NAME/keypoints` (m x 2), `NAME/matches` (k x 2: keypoint of the query, keypoint
of the image) and `NAME/cam_from_world` (3 x 4).
"""

import sys

import numpy as np

import colmap_lazyloc as ll

data = np.load(sys.argv[1])
fx, fy, cx, cy, width, height = data["camera"]
camera = {"model": "PINHOLE", "width": width, "height": height, "params": [fx, fy, cx, cy]}
names = sorted({key.rpartition("/")[0] for key in data if "/" in key})

poses = {name: data[f"{name}/cam_from_world"] for name in names}
model = {name: (pose[:, :3], pose[:, 3], camera) for name, pose in poses.items()}
pairs = {name: (data[f"{name}/keypoints"], data[f"{name}/matches"]) for name in names}
result = ll.Localizer(None, model).localize_matches(camera, data["keypoints"], pairs)
print(result.status, result.reason)
print(result.cam_from_world)

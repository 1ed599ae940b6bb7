"""Localizes the photos that a camera rig took at one moment. They share one unknown pose.

    python localize_rig.py database.db model rig.json

`rig.json` has cam_from_rig, a 3 x 4 matrix, for each photo: {"left.jpg": [[1, 0, 0, 0], ...], "right.jpg": ...}.
Photos are files in its folder.
"""

import json
import pathlib
import sys

import colmap_lazyloc as ll

database, model, rig_path = sys.argv[1:]
path = pathlib.Path(rig_path)
rig = {ll.Photo(path.parent / name, name=name): pose for name, pose in json.loads(path.read_text()).items()}
with ll.Localizer(database, model) as localizer:
    results = localizer.localize_rig(rig)
for name, result in results.items():
    print(name, result.status, "" if result.pose is None else result.pose.text())

"""Localizes one query at a time from hloc's feature and match files, for example of SuperPoint and LightGlue.

    python localize_hloc.py model queries.txt pairs.txt features.h5 matches.h5

`colmap_lazyloc.hloc` takes the place of hloc.localize_sfm and writes its files. This program shows what happens inside:
hloc's keypoints plus half a pixel are COLMAP's, and `matches0` has an index into the other image's keypoints, or -1.
"""

import sys

import h5py

import colmap_lazyloc as ll
from colmap_lazyloc.hloc_files import find_matches, read_keypoints
from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.queries import read_query_cameras

model, queries, pairs_path, features_path, matches_path = sys.argv[1:]
retrieved: dict[str, list[str]] = {}
for query, other in read_pairs(pairs_path):
    retrieved.setdefault(query, []).append(other)
with h5py.File(features_path) as features, h5py.File(matches_path) as matches, ll.Localizer(None, model) as localizer:
    for name, camera in read_query_cameras(queries).items():
        pairs = {}
        for other in retrieved.get(name, []):
            found = find_matches(matches, name, other)
            if found is not None:
                pairs[other] = (read_keypoints(features, other), found)
        result = localizer.localize_matches(camera, read_keypoints(features, name), pairs, name=name)
        print(name, result.status, f"{result.num_inliers} inliers")

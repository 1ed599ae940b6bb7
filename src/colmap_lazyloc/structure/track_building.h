#pragma once

#include <vector>

#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Builds tracks over the inlier matches of pairs, each track with at least one observation in a query, in ascending
// order of their first observations. Points are not set. Images 0 to n-1 are the queries; frame_of_query holds their
// frames. Pairs of one query must ascend by their other image. Rules:
//
//  (1) A query keypoint with matches in two or more database images makes a track of its own, with its database
//      observations only.       query a  o-----o database 1
//                                         \----o database 2
//  (2) Other keypoints are merged over all queries of their frame by union-find, and over other frames if one of the
//      two queries has few keypoints of rule 1.
//                               query a  o-----o query b -----o database 1
//  (3) Merged tracks with two keypoints in one image are split: each query keypoint keeps its own database matches,
//      because some of the matches must be false.
//
// Long tracks over many queries would tie the queries to each other more tightly than inaccurate database poses let
// them be tied to the database. A keypoint that is matched twice within a pair is ambiguous: its matches are dropped.
std::vector<Track> BuildTracks(const PairRefs& pairs, const std::vector<int>& frame_of_query = {0});

}  // namespace lazyloc

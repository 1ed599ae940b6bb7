#pragma once

#include <cstddef>
#include <vector>

#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// The inlier matches between a query and another view, with the observations of each match. The other view is a
// database view, or an earlier query.
struct ViewMatches {
  int view = -1;
  Matches matches;
  std::vector<Observation> query_observations;     // parallel to matches
  std::vector<Observation> database_observations;  // parallel to matches
  int query_view = 0;

  void Reserve(size_t size) {
    matches.reserve(size);
    query_observations.reserve(size);
    database_observations.reserve(size);
  }
  void Add(const Match& match, const Observation& query, const Observation& database) {
    matches.push_back(match);
    query_observations.push_back(query);
    database_observations.push_back(database);
  }
};

// The tracks of keypoints that matches join, each with at least one query's, in order of their first image points.
// Views 0 to n-1 are the queries; frame_of_query says which of them move as one. Points are not set. A query keypoint
// with matches in two or more database views stands on these alone; the others are joined over the queries of a frame,
// and with those of a frame one of whose queries has few that stand alone, where also one that stands alone is joined
// with such a query's. Long tracks through many queries would tie them to each other more tightly than database poses
// that are off let them be tied to the database.
// A keypoint that is matched twice within a pair is ambiguous: those matches are dropped. Where joined matches lead to
// two keypoints of one view, some of them are false: each query keypoint then has its own matches in the database
// alone.
std::vector<Track> BuildTracks(const std::vector<ViewMatches>& view_matches,
                               const std::vector<int>& frame_of_query = {0});

}  // namespace lazyloc

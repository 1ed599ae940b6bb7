#pragma once

#include <cstddef>
#include <vector>

#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// The inlier matches between the query (view 0) and a database view, with the observations of each match.
struct ViewMatches {
  int view = -1;
  Matches matches;
  std::vector<Observation> query_observations;     // parallel to matches
  std::vector<Observation> database_observations;  // parallel to matches

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

// For each query keypoint, the track of all its inlier matches in the database views, in order of the query keypoints.
// A keypoint that is matched twice within a pair is ambiguous: those matches are dropped. Points are not set.
std::vector<Track> BuildTracks(const std::vector<ViewMatches>& view_matches);

}  // namespace lazyloc

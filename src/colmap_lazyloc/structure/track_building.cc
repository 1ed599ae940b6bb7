#include "colmap_lazyloc/structure/track_building.h"

#include <algorithm>

namespace lazyloc {
namespace {

// How often each keypoint is matched within a pair. Flat, by keypoint: as large as the largest index asks for.
class UseCounter {
 public:
  void Add(uint32_t keypoint) {
    if (keypoint >= uses_.size()) uses_.resize(keypoint + 1, 0);
    ++uses_[keypoint];
  }
  int operator[](uint32_t keypoint) const { return uses_[keypoint]; }
  void Clear(uint32_t keypoint) { uses_[keypoint] = 0; }

 private:
  std::vector<int> uses_;
};

// The matches of each pair, by index, whose keypoints are matched once.
std::vector<std::vector<size_t>> UnambiguousMatches(const std::vector<ViewMatches>& view_matches) {
  std::vector<std::vector<size_t>> unambiguous(view_matches.size());
  UseCounter query, database;
  for (size_t pair = 0; pair < view_matches.size(); ++pair) {
    const Matches& matches = view_matches[pair].matches;
    for (const Match& match : matches) {
      query.Add(match.query_point);
      database.Add(match.database_point);
    }
    unambiguous[pair].reserve(matches.size());
    for (size_t i = 0; i < matches.size(); ++i) {
      if (query[matches[i].query_point] == 1 && database[matches[i].database_point] == 1)
        unambiguous[pair].push_back(i);
    }
    for (const Match& match : matches) {
      query.Clear(match.query_point);
      database.Clear(match.database_point);
    }
  }
  return unambiguous;
}

}  // namespace

std::vector<Track> BuildTracks(const std::vector<ViewMatches>& view_matches) {
  const std::vector<std::vector<size_t>> unambiguous = UnambiguousMatches(view_matches);
  std::vector<int> num_matches;  // of each query keypoint
  for (size_t pair = 0; pair < view_matches.size(); ++pair) {
    for (const size_t i : unambiguous[pair]) {
      const uint32_t query_point = view_matches[pair].matches[i].query_point;
      if (query_point >= num_matches.size()) num_matches.resize(query_point + 1, 0);
      ++num_matches[query_point];
    }
  }
  std::vector<Track> tracks(num_matches.size() - std::count(num_matches.begin(), num_matches.end(), 0));
  std::vector<Track*> track_of_query_point(num_matches.size(), nullptr);
  auto next = tracks.begin();
  for (size_t query_point = 0; query_point < num_matches.size(); ++query_point) {
    if (num_matches[query_point] == 0) continue;
    next->observations.reserve(num_matches[query_point] + 1);
    track_of_query_point[query_point] = &*next++;
  }
  for (size_t pair = 0; pair < view_matches.size(); ++pair) {
    const ViewMatches& matches = view_matches[pair];
    for (const size_t i : unambiguous[pair]) {
      const Match& match = matches.matches[i];
      std::vector<TrackObservation>& observations = track_of_query_point[match.query_point]->observations;
      if (observations.empty()) {
        observations.push_back({0, static_cast<int>(match.query_point), matches.query_observations[i]});
      }
      observations.push_back({matches.view, static_cast<int>(match.database_point), matches.database_observations[i]});
    }
  }
  return tracks;
}

}  // namespace lazyloc

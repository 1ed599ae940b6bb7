#include "colmap_lazyloc/structure/track_building.h"

#include <map>
#include <unordered_map>

namespace lazyloc {

std::vector<Track> BuildTracks(const std::vector<ViewMatches>& view_matches) {
  std::map<uint32_t, Track> track_of_query_point;
  for (const ViewMatches& pair : view_matches) {
    std::unordered_map<uint32_t, int> uses_of_query_point, uses_of_database_point;
    for (const Match& match : pair.matches) {
      ++uses_of_query_point[match.query_point];
      ++uses_of_database_point[match.database_point];
    }
    for (size_t i = 0; i < pair.matches.size(); ++i) {
      const Match& match = pair.matches[i];
      if (uses_of_query_point[match.query_point] > 1 || uses_of_database_point[match.database_point] > 1) continue;
      Track& track = track_of_query_point[match.query_point];
      if (track.observations.empty()) {
        track.observations.push_back({0, static_cast<int>(match.query_point), pair.query_observations[i]});
      }
      track.observations.push_back({pair.view, static_cast<int>(match.database_point), pair.database_observations[i]});
    }
  }
  std::vector<Track> tracks;
  tracks.reserve(track_of_query_point.size());
  for (auto& [query_point, track] : track_of_query_point) tracks.push_back(std::move(track));
  return tracks;
}

}  // namespace lazyloc

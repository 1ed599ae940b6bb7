#include "colmap_lazyloc/group/track_collection.h"

#include <iterator>
#include <utility>

#include "colmap_lazyloc/structure/track_building.h"
#include "colmap_lazyloc/structure/track_selection.h"

namespace lazyloc {
namespace {

// Selects at most max_num_tracks for each query, among the tracks with their first observation there.
std::vector<Track> SelectTracksOfEach(const QueryGroup& group, const std::vector<Track>& tracks, int max_num_tracks) {
  if (static_cast<int>(tracks.size()) <= max_num_tracks) return tracks;
  if (group.images.size() == 1) {
    return SelectTracks(tracks, group.images.front().problem.query_keypoints, max_num_tracks);
  }
  std::vector<std::vector<Track>> tracks_of_query(group.images.size());
  for (const Track& track : tracks) tracks_of_query[track.observations.front().image].push_back(track);
  std::vector<Track> selected;
  for (size_t query = 0; query < group.images.size(); ++query) {
    std::vector<Track> of_query =
        SelectTracks(std::move(tracks_of_query[query]), group.images[query].problem.query_keypoints, max_num_tracks);
    std::move(of_query.begin(), of_query.end(), std::back_inserter(selected));
  }
  return selected;
}

}  // namespace

CandidateTracks CollectTracks(const QueryGroup& group, const Layout& layout, const PairRefs& pairs,
                              const LocalizerOptions& options) {
  std::vector<int> frame_of_query;
  for (int query = 0; query < layout.num_queries; ++query) frame_of_query.push_back(layout.FrameOf(query));
  CandidateTracks candidates;
  candidates.all = BuildTracks(pairs, frame_of_query);
  if (static_cast<int>(candidates.all.size()) > options.max_num_tracks) {
    candidates.all = SelectTracksOfEach(group, candidates.all, options.max_num_tracks);
  }
  candidates.for_start = SelectTracksOfEach(group, candidates.all, options.max_num_start_tracks);
  return candidates;
}

}  // namespace lazyloc

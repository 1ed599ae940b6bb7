#include "colmap_lazyloc/group/track_collection.h"

#include <iterator>
#include <utility>

#include "colmap_lazyloc/structure/track_building.h"
#include "colmap_lazyloc/structure/track_selection.h"

namespace lazyloc {
namespace {

// Selects at most kMaxNumStartTracks for each query, among the tracks with their first observation there.
std::vector<Track> SelectTracksOfEach(const QueryGroup& group, const std::vector<Track>& tracks) {
  if (static_cast<int>(tracks.size()) <= kMaxNumStartTracks) return tracks;
  if (group.images.size() == 1) {
    return SelectTracks(tracks, group.images.front().problem.query_keypoints, kMaxNumStartTracks);
  }
  std::vector<std::vector<Track>> tracks_of_query(group.images.size());
  for (const Track& track : tracks) tracks_of_query[track.observations.front().image].push_back(track);
  std::vector<Track> selected;
  for (size_t query = 0; query < group.images.size(); ++query) {
    std::vector<Track> of_query =
        SelectTracks(tracks_of_query[query], group.images[query].problem.query_keypoints, kMaxNumStartTracks);
    std::move(of_query.begin(), of_query.end(), std::back_inserter(selected));
  }
  return selected;
}

}  // namespace

CandidateTracks CollectTracks(const QueryGroup& group, const Layout& layout, const PairRefs& pairs) {
  std::vector<int> frame_of_query;
  for (int query = 0; query < layout.num_queries; ++query) frame_of_query.push_back(layout.FrameOf(query));
  CandidateTracks candidates;
  candidates.all = BuildTracks(pairs, frame_of_query);
  candidates.for_start = SelectTracksOfEach(group, candidates.all);
  return candidates;
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/track_collection.h"

#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "colmap_lazyloc/structure/track_selection.h"

namespace lazyloc {
namespace {

// At most max_num_tracks for each query's image, of the tracks that have their first image point there.
std::vector<Track> SelectTracksOfEach(const QueryState& state, std::vector<Track> tracks, int max_num_tracks) {
  std::vector<std::vector<Track>> tracks_of_query(state.NumQueries());
  for (Track& track : tracks) tracks_of_query[track.observations.front().view].push_back(std::move(track));
  tracks.clear();
  for (int query = 0; query < state.NumQueries(); ++query) {
    std::vector<Track> selected =
        SelectTracks(std::move(tracks_of_query[query]), state.Problem(query).query_keypoints, max_num_tracks);
    std::move(selected.begin(), selected.end(), std::back_inserter(tracks));
  }
  return tracks;
}

}  // namespace

void ObserveMatches(QueryState* state) {
  for (View& view : state->views) view.noise_px = state->options.start_noise_px;
  for (PairState& pair : state->pairs) {
    pair.view_matches = state->Observe(pair, pair.relative_pose.inlier_matches);
  }
}

void CollectTracks(QueryState* state) {
  std::vector<ViewMatches> view_matches;
  for (PairState& pair : state->pairs) view_matches.push_back(std::move(pair.view_matches));
  std::vector<int> frame_of_query;
  for (int query = 0; query < state->NumQueries(); ++query) frame_of_query.push_back(state->FrameOf(query));
  std::vector<Track> tracks = BuildTracks(view_matches, frame_of_query);
  state->candidates = SelectTracksOfEach(*state, std::move(tracks), state->options.max_num_tracks);
  state->start_candidates = SelectTracksOfEach(*state, state->candidates, state->options.max_num_start_tracks);
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/track_collection.h"

#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/refinement/sampson_error.h"
#include "colmap_lazyloc/structure/track_extension.h"
#include "colmap_lazyloc/structure/track_selection.h"

namespace lazyloc {
namespace {

// By matches among the database images of the pairs in use.
void ExtendByDatabaseMatches(const QueryState& state, std::vector<Track>* tracks) {
  std::vector<std::optional<Observer>> observers(state.views.size());
  std::vector<const ImagePair*> images(state.views.size(), nullptr);
  for (const PairState& pair : state.pairs) {
    if (!state.HasDatabaseImage(pair)) continue;
    images[pair.view] = &state.Images(pair);
    observers[pair.view].emplace(images[pair.view]->database_camera);
  }
  std::vector<DatabaseViewMatches> matches;
  for (int query = 0; query < state.NumQueries(); ++query) {
    for (const DatabaseMatches& pair : state.Problem(query).database_matches) {
      const int view1 = state.pair_views[query][pair.pair1], view2 = state.pair_views[query][pair.pair2];
      if (observers[view1] && observers[view2]) matches.push_back({view1, view2, &pair.keypoints});
    }
  }
  if (matches.empty()) return;
  const auto observe = [&](int view, uint32_t keypoint) {
    return (*observers[view])(images[view]->database_keypoints[keypoint]);
  };
  ExtendTracks(matches, observe, tracks);
}

// Those of a pair's matches that lie near their epipolar lines.
ViewMatches Inliers(const ViewMatches& matches, double max_error_sigma, const std::vector<View>& views) {
  ViewMatches inliers;
  inliers.query_view = matches.query_view;
  inliers.view = matches.view;
  const View& query = views[matches.query_view];
  const Eigen::Matrix3d rotation = query.cam_from_world.rotation.toRotationMatrix();
  const Eigen::Vector3d cam_in_world = CamInWorld(query.cam_from_world);
  Eigen::Matrix<double, 1, 6> jacobian;
  for (size_t i = 0; i < matches.matches.size(); ++i) {
    const EpipolarMatch match = MakeEpipolarMatch(views[matches.view], matches.database_observations[i], query,
                                                  matches.query_observations[i], /*noise_ratio=*/1);
    if (std::abs(SampsonError(match, rotation, cam_in_world, &jacobian)) > max_error_sigma) continue;
    inliers.Add(matches.matches[i], matches.query_observations[i], matches.database_observations[i]);
  }
  return inliers;
}

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
  std::vector<Track> tracks = BuildTracks(view_matches, state->NumQueries());
  ExtendByDatabaseMatches(*state, &tracks);
  state->candidates = SelectTracksOfEach(*state, std::move(tracks), state->options.max_num_tracks);
  state->start_candidates = SelectTracksOfEach(*state, state->candidates, state->options.max_num_start_tracks);
}

void CollectTracksAgain(QueryState* state) {
  for (PairState& pair : state->pairs) {
    const Matches& raw = state->Images(pair).matches;
    const Matches& matches = raw.empty() ? pair.relative_pose.inlier_matches : raw;
    pair.view_matches =
        Inliers(state->Observe(pair, matches), state->options.triangulation.max_query_error_sigma, state->views);
  }
  CollectTracks(state);
}

}  // namespace lazyloc

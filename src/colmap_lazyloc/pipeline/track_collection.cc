#include "colmap_lazyloc/pipeline/track_collection.h"

#include <cmath>
#include <optional>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/refinement/sampson_error.h"
#include "colmap_lazyloc/structure/track_extension.h"
#include "colmap_lazyloc/structure/track_selection.h"

namespace lazyloc {
namespace {

// By matches among the database images of the pairs in use.
void ExtendByDatabaseMatches(const QueryState& state, std::vector<Track>* tracks) {
  const std::vector<ImagePair>& images = state.problem.pairs;
  std::vector<std::optional<Observer>> observers(images.size());
  for (const PairState& pair : state.pairs) observers[pair.index].emplace(images[pair.index].database_camera);
  std::vector<DatabaseViewMatches> matches;
  for (const DatabaseMatches& pair : state.problem.database_matches) {
    if (!observers[pair.pair1] || !observers[pair.pair2]) continue;
    matches.push_back({pair.pair1 + 1, pair.pair2 + 1, &pair.keypoints});
  }
  if (matches.empty()) return;
  const auto observe = [&](int view, uint32_t keypoint) {
    return (*observers[view - 1])(images[view - 1].database_keypoints[keypoint]);
  };
  ExtendTracks(matches, observe, tracks);
}

// Those of a pair's matches that lie near their epipolar lines.
ViewMatches Inliers(const ViewMatches& matches, double max_error_sigma, const std::vector<View>& views) {
  ViewMatches inliers;
  inliers.view = matches.view;
  const Eigen::Matrix3d rotation = views[0].cam_from_world.rotation.toRotationMatrix();
  const Eigen::Vector3d cam_in_world = CamInWorld(views[0].cam_from_world);
  Eigen::Matrix<double, 1, 6> jacobian;
  for (size_t i = 0; i < matches.matches.size(); ++i) {
    const EpipolarMatch match = MakeEpipolarMatch(views[matches.view], matches.database_observations[i], views[0],
                                                  matches.query_observations[i], /*noise_ratio=*/1);
    if (std::abs(SampsonError(match, rotation, cam_in_world, &jacobian)) > max_error_sigma) continue;
    inliers.Add(matches.matches[i], matches.query_observations[i], matches.database_observations[i]);
  }
  return inliers;
}

}  // namespace

void ObserveMatches(QueryState* state) {
  for (View& view : state->views) view.noise_px = state->options.start_noise_px;
  for (PairState& pair : state->pairs) {
    pair.view_matches = state->Observe(pair.index, pair.relative_pose.inlier_matches);
  }
}

void CollectTracks(QueryState* state) {
  std::vector<ViewMatches> view_matches;
  for (PairState& pair : state->pairs) view_matches.push_back(std::move(pair.view_matches));
  std::vector<Track> tracks = BuildTracks(view_matches);
  ExtendByDatabaseMatches(*state, &tracks);
  state->candidates = SelectTracks(std::move(tracks), state->problem.query_keypoints, state->options.max_num_tracks);
  state->start_candidates =
      SelectTracks(state->candidates, state->problem.query_keypoints, state->options.max_num_start_tracks);
}

void CollectTracksAgain(QueryState* state) {
  for (PairState& pair : state->pairs) {
    const Matches& raw = state->problem.pairs[pair.index].matches;
    const Matches& matches = raw.empty() ? pair.relative_pose.inlier_matches : raw;
    pair.view_matches =
        Inliers(state->Observe(pair.index, matches), state->options.triangulation.max_query_error_sigma, state->views);
  }
  CollectTracks(state);
}

}  // namespace lazyloc

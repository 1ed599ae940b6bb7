#include "colmap_lazyloc/pipeline/query_state.h"

#include <limits>

#include "colmap_lazyloc/bridge/observation.h"

namespace lazyloc {

QueryState::QueryState(const LocalizationProblem& query_problem, const LocalizerOptions& query_options)
    : problem(query_problem),
      options(query_options),
      views(query_problem.pairs.size() + 1),
      query_camera(query_problem.query_camera) {
  result.query_name = problem.query_name;
  result.query_camera = problem.query_camera;
  for (const ImagePair& pair : problem.pairs) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    result.pairs.push_back({pair.database_name, 0, kNone, kNone});
    origin += CamInWorld(pair.database_cam_from_world) / static_cast<double>(problem.pairs.size());
  }
  const bool has_focal_length = !SameIntrinsics(WithFocalFactor(query_camera, 2), query_camera);
  if (options.refine_focal_length && has_focal_length && !query_camera.has_prior_focal_length) {
    views[0].log_focal_factor = 0;
  }
  for (size_t view = 1; view < views.size(); ++view) views[view] = {GivenPose(view), /*is_database=*/true};
}

Rigid3d QueryState::GivenPose(size_t view) const {
  Rigid3d cam_from_world = problem.pairs[view - 1].database_cam_from_world;
  cam_from_world.rotation.normalize();
  cam_from_world.translation += cam_from_world.rotation * origin;
  return cam_from_world;
}

ViewMatches QueryState::Observe(int pair_index, const Matches& matches) {
  const ImagePair& images = problem.pairs[pair_index];
  const Observer observe_query(query_camera, SeeksFocalLength()), observe_database(images.database_camera);
  query_observations.resize(problem.query_keypoints.size());
  ViewMatches observed;
  observed.view = pair_index + 1;
  observed.Reserve(matches.size());
  for (const Match& match : matches) {
    std::optional<std::optional<Observation>>& query = query_observations[match.query_point];
    if (!query) query = observe_query(problem.query_keypoints[match.query_point]);
    const auto database = observe_database(images.database_keypoints[match.database_point]);
    if (*query && database) observed.Add(match, **query, *database);
  }
  return observed;
}

void QueryState::ScaleFocalLength(double factor) {
  query_camera = WithFocalFactor(query_camera, factor);
  query_observations.assign(problem.query_keypoints.size(), std::nullopt);
  for (PairState& pair : pairs) pair.view_matches = Observe(pair.index, pair.view_matches.matches);
  for (std::vector<Track>* group :
       {&candidates, &start_candidates, &tracks_from_database, &tracks_with_query, &tracks}) {
    *group = ObservedBy(query_camera, *group);
  }
}

std::vector<Track> QueryState::ObservedBy(const Camera& camera, const std::vector<Track>& given_tracks) const {
  const Observer observe(camera, SeeksFocalLength());
  std::vector<Track> observed;
  for (const Track& track : given_tracks) {
    const std::optional<Observation> query = observe(problem.query_keypoints[track.observations.front().keypoint]);
    if (!query) continue;
    observed.push_back(track);
    observed.back().observations.front().observation = *query;
  }
  return observed;
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/query_state.h"

#include <limits>

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
  for (size_t view = 1; view < views.size(); ++view) views[view] = {GivenPose(view), /*is_database=*/true};
}

Rigid3d QueryState::GivenPose(size_t view) const {
  Rigid3d cam_from_world = problem.pairs[view - 1].database_cam_from_world;
  cam_from_world.rotation.normalize();
  cam_from_world.translation += cam_from_world.rotation * origin;
  return cam_from_world;
}

}  // namespace lazyloc

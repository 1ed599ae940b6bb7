#include "colmap_lazyloc/bridge/generalized_relative_pose.h"

#include <Eigen/Geometry>
#if __has_include(<colmap/estimators/solvers/generalized_relative_pose.h>)
#include <colmap/estimators/solvers/generalized_relative_pose.h>  // COLMAP 4
#else
#include <colmap/estimators/generalized_relative_pose.h>
#endif
#include <colmap/optim/ransac.h>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/random_numbers.h"

namespace lazyloc {
namespace {

// Solver of Kneip and Li. COLMAP 4 calls it GR8PEstimator, because its GR6PEstimator is a minimal solver, which takes a
// hundred times as long.
#if __has_include(<colmap/estimators/solvers/generalized_relative_pose.h>)
using Estimator = colmap::GR8PEstimator;
#else
using Estimator = colmap::GR6PEstimator;
#endif

}  // namespace

std::optional<Rigid3d> EstimateGeneralizedRelativePose(const std::vector<PosedRayMatch>& matches, double max_error_rad,
                                                       uint32_t seed) {
  std::vector<Estimator::X_t> database(matches.size()), query(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    database[i] = {ToColmap(matches[i].database_cam_from_world), matches[i].database_ray_in_cam};
    query[i] = {ToColmap(matches[i].query_cam_from_reference), matches[i].query_ray_in_cam};
  }
  colmap::RANSACOptions options;
  options.max_error = max_error_rad;
  options.min_inlier_ratio = 0.3;
  options.confidence = 0.999;
  options.max_num_trials = 500;
  SeedRandomNumbers(seed);
  const auto report = colmap::RANSAC<Estimator>(options).Estimate(database, query);
  return report.success ? FiniteRigid(report.model) : std::nullopt;
}

}  // namespace lazyloc

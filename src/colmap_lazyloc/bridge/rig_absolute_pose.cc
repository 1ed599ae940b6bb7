#include <cmath>

#include "colmap_lazyloc/bridge/absolute_pose.h"

#if __has_include(<colmap/estimators/solvers/generalized_absolute_pose.h>)
#include <colmap/estimators/solvers/generalized_absolute_pose.h>  // COLMAP 4
#else
#include <colmap/estimators/generalized_absolute_pose.h>
#endif
#include <colmap/math/random.h>
#include <colmap/optim/ransac.h>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/ransac_options.h"

namespace lazyloc {
namespace {

using colmap::GP3PEstimator;

GP3PEstimator::X_t RigRay(const Rigid3d& cam_from_rig, const Eigen::Vector3d& ray_in_cam) {
#if __has_include(<colmap/estimators/solvers/generalized_absolute_pose.h>)
  return {ToColmap(cam_from_rig).ToMatrix(), ray_in_cam};
#else
  return {ToColmap(cam_from_rig), ray_in_cam};
#endif
}

}  // namespace

std::optional<Rigid3d> EstimateRigAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                               const std::vector<Rigid3d>& cams_from_reference,
                                               const std::vector<Eigen::Vector3d>& points_in_world,
                                               double max_error_rad, uint32_t seed, double min_inlier_ratio) {
  std::vector<GP3PEstimator::X_t> rays(rays_in_cam.size());
  for (size_t i = 0; i < rays.size(); ++i) rays[i] = RigRay(cams_from_reference[i], rays_in_cam[i]);
  colmap::SetPRNGSeed(seed);
  // Converts the bound, because the estimator's residual is (1 - cos(angle))^2.
  colmap::RANSAC<GP3PEstimator> ransac(AbsolutePoseRansacOptions(1 - std::cos(max_error_rad), min_inlier_ratio));
  const auto report = ransac.Estimate(rays, points_in_world);
  if (!report.success) return std::nullopt;
  return FiniteRigid(report.model.ToMatrix());
}

}  // namespace lazyloc

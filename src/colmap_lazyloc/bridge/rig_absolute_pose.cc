#include <cmath>

#include "colmap_lazyloc/bridge/absolute_pose.h"

#if __has_include(<colmap/estimators/solvers/generalized_absolute_pose.h>)
#include <colmap/estimators/solvers/generalized_absolute_pose.h>  // COLMAP 4
#else
#include <colmap/estimators/generalized_absolute_pose.h>
#endif

#include "colmap_lazyloc/bridge/absolute_pose_ransac.h"

namespace lazyloc {
namespace {

using colmap::GP3PEstimator;

// Solves with the same random numbers each time, because COLMAP 4 calls PoseLib, which turns the rays by a random
// rotation from std::rand().
struct RepeatableEstimator : GP3PEstimator {
  void Estimate(const std::vector<X_t>& rays, const std::vector<Y_t>& points, std::vector<M_t>* rigs_from_world) {
    const ExclusiveRand rand(0);
    GP3PEstimator::Estimate(rays, points, rigs_from_world);
  }
};

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
  // Converts the bound, because the estimator's residual is (1 - cos(angle))^2.
  return EstimateByRansac<colmap::RANSAC<RepeatableEstimator>>(rays, points_in_world, 1 - std::cos(max_error_rad), seed,
                                                               min_inlier_ratio);
}

}  // namespace lazyloc

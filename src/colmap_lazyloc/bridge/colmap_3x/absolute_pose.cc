#include "colmap_lazyloc/bridge/absolute_pose.h"

#include <algorithm>

#include <Eigen/Geometry>
#include <colmap/estimators/absolute_pose.h>
#include <colmap/optim/loransac.h>

#include "colmap_lazyloc/bridge/absolute_pose_ransac.h"

namespace lazyloc {

std::optional<Rigid3d> EstimateAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                            const std::vector<Eigen::Vector3d>& points_in_world, double max_error_rad,
                                            uint32_t seed, double min_inlier_ratio) {
  constexpr double kMinDepth = 0.05;  // z of rays that COLMAP 3 can project to the plane z = 1
  const auto is_behind = [](const Eigen::Vector3d& ray) { return ray.z() <= kMinDepth; };
  if (std::any_of(rays_in_cam.begin(), rays_in_cam.end(), is_behind)) {
    // Gives each ray a camera of its own that looks along it, because COLMAP 3 takes only points in front of cameras.
    const std::vector<Eigen::Vector3d> axes(rays_in_cam.size(), Eigen::Vector3d::UnitZ());
    std::vector<Rigid3d> cams_from_reference(rays_in_cam.size());
    for (size_t i = 0; i < rays_in_cam.size(); ++i) {
      cams_from_reference[i].rotation = Eigen::Quaterniond::FromTwoVectors(rays_in_cam[i], axes[i]);
    }
    return EstimateRigAbsolutePose(axes, cams_from_reference, points_in_world, max_error_rad, seed, min_inlier_ratio);
  }
  std::vector<Eigen::Vector2d> normalized(rays_in_cam.size());
  for (size_t i = 0; i < normalized.size(); ++i) normalized[i] = rays_in_cam[i].hnormalized();
  using Ransac = colmap::LORANSAC<colmap::P3PEstimator, colmap::EPNPEstimator>;
  return EstimateByRansac<Ransac>(normalized, points_in_world, max_error_rad, seed, min_inlier_ratio);
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/absolute_pose.h"

#include <Eigen/Geometry>
#include <colmap/estimators/absolute_pose.h>
#include <colmap/optim/loransac.h>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/random_numbers.h"
#include "colmap_lazyloc/bridge/ransac_options.h"

namespace lazyloc {

std::optional<Rigid3d> EstimateAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                            const std::vector<Eigen::Vector3d>& points_in_world, double max_error_rad,
                                            uint32_t seed, double min_inlier_ratio) {
  std::vector<Eigen::Vector2d> normalized(rays_in_cam.size());
  for (size_t i = 0; i < normalized.size(); ++i) normalized[i] = rays_in_cam[i].hnormalized();
  SeedRandomNumbers(seed);
  colmap::LORANSAC<colmap::P3PEstimator, colmap::EPNPEstimator> ransac(
      AbsolutePoseRansacOptions(max_error_rad, min_inlier_ratio));
  const auto report = ransac.Estimate(normalized, points_in_world);
  if (!report.success) return std::nullopt;
  return FiniteRigid(report.model);
}

}  // namespace lazyloc

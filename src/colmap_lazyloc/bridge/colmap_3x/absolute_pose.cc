#include "colmap_lazyloc/bridge/absolute_pose.h"

#include <Eigen/Geometry>
#include <colmap/estimators/absolute_pose.h>
#include <colmap/math/random.h>
#include <colmap/optim/loransac.h>

namespace lazyloc {

std::optional<Rigid3d> EstimateAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                            const std::vector<Eigen::Vector3d>& points_in_world, double max_error_rad,
                                            uint32_t seed, double min_inlier_ratio) {
  std::vector<Eigen::Vector2d> normalized(rays_in_cam.size());
  for (size_t i = 0; i < normalized.size(); ++i) normalized[i] = rays_in_cam[i].hnormalized();
  colmap::RANSACOptions options;
  options.max_error = max_error_rad;
  options.min_inlier_ratio = min_inlier_ratio;
  options.confidence = 0.9999;
  options.min_num_trials = 50;
  options.max_num_trials = 5000;
  // RANSAC draws from a generator of the thread's.
  colmap::SetPRNGSeed(seed);
  colmap::LORANSAC<colmap::P3PEstimator, colmap::EPNPEstimator> ransac(options);
  const auto report = ransac.Estimate(normalized, points_in_world);
  if (!report.success) return std::nullopt;
  const Eigen::Quaterniond rotation(Eigen::Matrix3d(report.model.leftCols<3>()));
  const Eigen::Vector3d translation = report.model.col(3);
  if (!rotation.coeffs().allFinite() || !translation.allFinite()) return std::nullopt;
  return Rigid3d{rotation.normalized(), translation};
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/absolute_pose.h"

#include <Eigen/Geometry>
#include <colmap/estimators/solvers/absolute_pose.h>
#include <colmap/math/random.h>
#include <colmap/optim/loransac.h>

namespace lazyloc {
namespace {

// COLMAP's estimator with errors in angles, that is for rays in all directions. Its projection serves EPnP to choose among
// its solutions.
template <typename Estimator>
class OnRays : public Estimator {
 public:
  OnRays() : Estimator([](const Eigen::Vector3d& point_in_cam) { return point_in_cam.hnormalized(); }) {}

  void Residuals(const std::vector<colmap::Point2DWithRay>& rays, const std::vector<Eigen::Vector3d>& points_in_world,
                 const Eigen::Matrix<double, 3, 4>& cam_from_world, std::vector<double>* residuals) const {
    residuals->resize(rays.size());
    for (size_t i = 0; i < rays.size(); ++i) {
      const Eigen::Vector3d point_in_cam = cam_from_world * points_in_world[i].homogeneous();
      (*residuals)[i] = (point_in_cam.normalized() - rays[i].camera_ray).squaredNorm();
    }
  }
};

}  // namespace

std::optional<Rigid3d> EstimateAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                            const std::vector<Eigen::Vector3d>& points_in_world, double max_error_rad,
                                            uint32_t seed, double min_inlier_ratio) {
  std::vector<colmap::Point2DWithRay> rays(rays_in_cam.size());
  for (size_t i = 0; i < rays.size(); ++i) rays[i] = {rays_in_cam[i].hnormalized(), rays_in_cam[i]};
  colmap::RANSACOptions options;
  options.max_error = max_error_rad;
  options.min_inlier_ratio = min_inlier_ratio;
  options.confidence = 0.9999;
  options.min_num_trials = 50;
  options.max_num_trials = 5000;
  // RANSAC draws from a generator of the thread's.
  colmap::SetPRNGSeed(seed);
  colmap::LORANSAC<OnRays<colmap::P3PEstimator>, OnRays<colmap::EPNPEstimator>> ransac(options);
  const auto report = ransac.Estimate(rays, points_in_world);
  if (!report.success) return std::nullopt;
  const Eigen::Quaterniond rotation(Eigen::Matrix3d(report.model.leftCols<3>()));
  const Eigen::Vector3d translation = report.model.col(3);
  if (!rotation.coeffs().allFinite() || !translation.allFinite()) return std::nullopt;
  return Rigid3d{rotation.normalized(), translation};
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/absolute_pose.h"

#include <Eigen/Geometry>
#include <colmap/estimators/solvers/absolute_pose.h>
#include <colmap/optim/loransac.h>

#include "colmap_lazyloc/bridge/absolute_pose_ransac.h"

namespace lazyloc {
namespace {

// COLMAP's estimator with angular errors instead of errors in the plane z = 1, because rays may have any direction.
// EPnP uses the projection to choose among its solutions.
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
  using Ransac = colmap::LORANSAC<OnRays<colmap::P3PEstimator>, OnRays<colmap::EPNPEstimator>>;
  return EstimateByRansac<Ransac>(rays, points_in_world, max_error_rad, seed, min_inlier_ratio);
}

}  // namespace lazyloc

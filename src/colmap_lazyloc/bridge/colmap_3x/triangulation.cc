#include "colmap_lazyloc/bridge/triangulation.h"

#include <algorithm>

#include <colmap/estimators/triangulation.h>
#include <colmap/optim/combination_sampler.h>
#include <colmap/optim/loransac.h>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/triangulation_ransac.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// COLMAP's estimator with an angular error that is never NaN. COLMAP 3.10 takes the arc cosine of a number that
// rounding may lift above 1, so that EstimateTriangulation may reject rays that meet exactly. COLMAP 4 has mended it.
class Estimator : public colmap::TriangulationEstimator {
 public:
  void Residuals(const std::vector<PointData>& points, const std::vector<PoseData>& poses,
                 const Eigen::Vector3d& point_in_world, std::vector<double>* residuals) const {
    residuals->resize(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d point_in_cam = poses[i].proj_matrix * point_in_world.homogeneous();
      const double error_rad = AngleBetweenRad(points[i].point_normalized.homogeneous(), point_in_cam);
      (*residuals)[i] = error_rad * error_rad;
    }
  }
};

}  // namespace

std::optional<Triangulation> TriangulateTrack(const std::vector<Rigid3d>& cams_from_world,
                                              const std::vector<Eigen::Vector3d>& rays_in_cam,
                                              double max_angular_error_rad, double min_triangulation_angle_rad) {
  LAZYLOC_CHECK(cams_from_world.size() == rays_in_cam.size());
  const auto is_forward = [](const Eigen::Vector3d& ray) { return ray.z() > 0; };
  if (rays_in_cam.size() < 2 || !std::all_of(rays_in_cam.begin(), rays_in_cam.end(), is_forward)) return std::nullopt;
  std::vector<Estimator::PointData> points;
  std::vector<Estimator::PoseData> poses;
  for (size_t i = 0; i < rays_in_cam.size(); ++i) {
    points.emplace_back(/*point=*/Eigen::Vector2d::Zero(), rays_in_cam[i].hnormalized());
    poses.emplace_back(ToColmap(cams_from_world[i]).ToMatrix(), CamInWorld(cams_from_world[i]), /*camera=*/nullptr);
  }
  colmap::LORANSAC<Estimator, Estimator, colmap::InlierSupportMeasurer, colmap::CombinationSampler> ransac(
      TriangulationRansacOptions(static_cast<int>(rays_in_cam.size()), max_angular_error_rad));
  ransac.estimator.SetMinTriAngle(min_triangulation_angle_rad);
  ransac.local_estimator.SetMinTriAngle(min_triangulation_angle_rad);
  const auto report = ransac.Estimate(points, poses);
  if (!report.success) return std::nullopt;
  return Triangulation{report.model, {report.inlier_mask.begin(), report.inlier_mask.end()}};
}

}  // namespace lazyloc

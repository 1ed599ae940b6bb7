#include "colmap_lazyloc/bridge/triangulation.h"

#include <algorithm>

#include <colmap/estimators/triangulation.h>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/triangulation_ransac.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

std::optional<Triangulation> TriangulateTrack(const std::vector<Rigid3d>& cams_from_world,
                                              const std::vector<Eigen::Vector3d>& rays_in_cam,
                                              double max_angular_error_rad, double min_triangulation_angle_rad) {
  LAZYLOC_CHECK(cams_from_world.size() == rays_in_cam.size());
  const auto is_forward = [](const Eigen::Vector3d& ray) { return ray.z() > 0; };
  if (rays_in_cam.size() < 2 || !std::all_of(rays_in_cam.begin(), rays_in_cam.end(), is_forward)) return std::nullopt;
  // Pixels of this camera are coordinates in the plane z = 1: focal length 1, principal point 0.
  static const colmap::Camera kUnitCamera = colmap::Camera::CreateFromModelName(
      /*camera_id=*/0, "SIMPLE_PINHOLE", /*focal_length=*/1, /*width=*/0, /*height=*/0);
  const std::vector<const colmap::Camera*> cameras(rays_in_cam.size(), &kUnitCamera);
  std::vector<Eigen::Vector2d> points;
  std::vector<colmap::Rigid3d> poses;
  for (size_t i = 0; i < rays_in_cam.size(); ++i) {
    points.push_back(rays_in_cam[i].hnormalized());
    poses.push_back(ToColmap(cams_from_world[i]));
  }
  colmap::EstimateTriangulationOptions options;
  options.min_tri_angle = min_triangulation_angle_rad;
  options.residual_type = colmap::TriangulationEstimator::ResidualType::ANGULAR_ERROR;
  options.ransac_options = TriangulationRansacOptions(static_cast<int>(rays_in_cam.size()), max_angular_error_rad);
  Triangulation triangulation;
  std::vector<char> inlier_mask;
  if (!colmap::EstimateTriangulation(options, points, poses, cameras, &inlier_mask, &triangulation.point_in_world)) {
    return std::nullopt;
  }
  triangulation.is_inlier.assign(inlier_mask.begin(), inlier_mask.end());
  return triangulation;
}

}  // namespace lazyloc

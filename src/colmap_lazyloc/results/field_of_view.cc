#include "colmap_lazyloc/results/field_of_view.h"

#include <algorithm>
#include <optional>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

constexpr int kNumSteps = 8;  // along a side of the image

// Returns points of a grid over the image, in pixels. Its border is not enough: that of a panorama is a line behind.
std::vector<Eigen::Vector2d> GridPixels(const Camera& camera) {
  const double width = static_cast<double>(camera.width), height = static_cast<double>(camera.height);
  std::vector<Eigen::Vector2d> pixels;
  for (int row = 0; row <= kNumSteps; ++row) {
    for (int column = 0; column <= kNumSteps; ++column) {
      pixels.emplace_back(width * column / kNumSteps, height * row / kNumSteps);
    }
  }
  return pixels;
}

// Returns twice the area of a triangle seen from above, positive if it is counterclockwise.
double Turn(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a;
  return ab.x() * ac.y() - ab.y() * ac.x();
}

// Returns the convex hull seen from above, counterclockwise (Andrew's monotone chain: the lower half from left to
// right, then the upper half).
std::vector<Eigen::Vector3d> HullFromAbove(std::vector<Eigen::Vector3d> points) {
  std::sort(points.begin(), points.end(),
            [](const auto& a, const auto& b) { return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y(); });
  std::vector<Eigen::Vector3d> hull;
  for (int half = 0; half < 2; ++half) {
    const size_t first = hull.size();
    for (const Eigen::Vector3d& point : points) {
      while (hull.size() >= first + 2 && Turn(hull[hull.size() - 2], hull.back(), point) <= 0) hull.pop_back();
      hull.push_back(point);
    }
    hull.pop_back();  // begins the other half
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

}  // namespace

std::vector<Eigen::Vector3d> FieldOfViewFromAbove(const Rigid3d& world_from_cam, const Camera& camera,
                                                  double distance) {
  const RayInCamFunction ray_in_cam = RaysInCam(camera);
  std::vector<Eigen::Vector3d> points = {world_from_cam.translation};
  for (const Eigen::Vector2d& pixel : GridPixels(camera)) {
    if (const std::optional<Eigen::Vector3d> ray = ray_in_cam(pixel))
      points.push_back(world_from_cam * (distance * *ray));
  }
  return points.size() < 3 ? std::vector<Eigen::Vector3d>() : HullFromAbove(std::move(points));
}

}  // namespace lazyloc

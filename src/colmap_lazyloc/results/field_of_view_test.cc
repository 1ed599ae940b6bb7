#include "colmap_lazyloc/results/field_of_view.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

// 90 degrees wide and 53 degrees high.
Camera Pinhole() { return {1, *CameraModelId("PINHOLE"), 400, 200, {200, 200, 200, 100}, true}; }

// Returns the pose at (1, 2, 3) of a camera that looks along y, turned about x.
Rigid3d WorldFromCam(double pitch_rad) {
  Eigen::Matrix3d level_camera;
  level_camera << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return {Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitX()) * Eigen::Quaterniond(level_camera), {1, 2, 3}};
}

// Returns the area seen from above, positive if the outline is counterclockwise.
double Area(const std::vector<Eigen::Vector3d>& outline) {
  double area = 0;
  for (size_t i = 0; i < outline.size(); ++i) {
    const Eigen::Vector3d &a = outline[i], &b = outline[(i + 1) % outline.size()];
    area += (a.x() * b.y() - a.y() * b.x()) / 2;
  }
  return area;
}

TEST(FieldOfView, IsAWedgeOfALevelCamera) {
  const std::vector<Eigen::Vector3d> outline = FieldOfViewFromAbove(WorldFromCam(0), Pinhole(), 10);
  int num_centres = 0;
  double left = 0, right = 0, farthest = 0;
  for (const Eigen::Vector3d& point : outline) {
    const Eigen::Vector3d ray = point - Eigen::Vector3d(1, 2, 3);
    if (ray.isZero()) {
      ++num_centres;
      continue;
    }
    EXPECT_NEAR(ray.norm(), 10, 1e-9);
    left = std::min(left, std::atan2(ray.x(), ray.y()));
    right = std::max(right, std::atan2(ray.x(), ray.y()));
    farthest = std::max(farthest, ray.y());
  }
  EXPECT_EQ(num_centres, 1);
  EXPECT_NEAR(left, -M_PI / 4, 1e-9);
  EXPECT_NEAR(right, M_PI / 4, 1e-9);
  EXPECT_NEAR(farthest, 10, 1e-9);
  EXPECT_GT(Area(outline), 0);
}

TEST(FieldOfView, IsTheOutlineOfAPhotoThatLooksDown) {
  const std::vector<Eigen::Vector3d> outline = FieldOfViewFromAbove(WorldFromCam(-M_PI / 2), Pinhole(), 10);
  double width = 0, height = 0;
  for (const Eigen::Vector3d& point : outline) {
    width = std::max(width, std::abs(point.x() - 1));
    height = std::max(height, std::abs(point.y() - 2));
    EXPECT_LT(point.z(), 3);
  }
  EXPECT_NEAR(width, 10 * std::sqrt(0.5), 1e-9);
  EXPECT_NEAR(height, 10 * std::sin(std::atan(0.5)), 1e-9);
  EXPECT_GT(Area(outline), 0);
}

TEST(FieldOfView, OfASphericalCameraIsADisc) {
  const Camera camera = {1, *CameraModelId("EQUIRECTANGULAR"), 800, 400, {800, 400}, true};
  const std::vector<Eigen::Vector3d> outline = FieldOfViewFromAbove(WorldFromCam(0), camera, 10);
  EXPECT_NEAR(Area(outline), 4 * std::sqrt(0.5) * 100, 1e-9) << "an octagon";
}

}  // namespace
}  // namespace lazyloc

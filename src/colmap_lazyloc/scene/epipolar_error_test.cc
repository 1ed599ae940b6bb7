#include "colmap_lazyloc/scene/epipolar_error.h"

#include <cmath>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500;

// Observes a point from a pinhole camera, with an error in pixels.
Observation Observe(const Eigen::Vector3d& point_in_cam, double error_px = 0) {
  Observation observation;
  const Eigen::Vector3d shifted = point_in_cam / point_in_cam.z() + Eigen::Vector3d(0, error_px / kFocalLengthPx, 0);
  observation.ray_in_cam = shifted.normalized();
  const double scale = kFocalLengthPx * shifted.norm();
  Eigen::Matrix<double, 2, 3> px_from_cam;
  px_from_cam << scale, 0, -scale * shifted.x(), 0, scale, -scale * shifted.y();
  observation.px_from_cam = px_from_cam;
  return observation;
}

class EpipolarErrorTest : public ::testing::Test {
 protected:
  const Rigid3d a_from_b_{Eigen::Quaterniond::Identity(), {-1, 0, 0}};
  const Eigen::Vector3d point_in_b_{0.3, 0.2, 5};
};

TEST_F(EpipolarErrorTest, IsZeroForARightMatch) {
  const EpipolarError error = MeasureEpipolarError(a_from_b_, Observe(a_from_b_ * point_in_b_), Observe(point_in_b_));
  EXPECT_NEAR(error.squared_px, 0, 1e-12);
  EXPECT_TRUE(error.is_in_front);
}

TEST_F(EpipolarErrorTest, IsTheDistanceFromTheLinesOfBothImages) {
  for (const double length : {1.0, 100.0}) {
    const Rigid3d a_from_b{a_from_b_.rotation, length * a_from_b_.translation};
    const EpipolarError error =
        MeasureEpipolarError(a_from_b, Observe(a_from_b_ * point_in_b_, 4), Observe(point_in_b_));
    EXPECT_NEAR(std::sqrt(error.squared_px), 4 / std::sqrt(2), 0.1) << "both images share the error";
  }
}

TEST_F(EpipolarErrorTest, BehindTheImagesItIsTheParallax) {
  const Rigid3d behind{a_from_b_.rotation, -a_from_b_.translation};
  const EpipolarError error = MeasureEpipolarError(behind, Observe(a_from_b_ * point_in_b_), Observe(point_in_b_));
  EXPECT_FALSE(error.is_in_front);
  EXPECT_NEAR(std::sqrt(error.squared_px), kFocalLengthPx / 5 / std::sqrt(2), 3);
}

}  // namespace
}  // namespace lazyloc

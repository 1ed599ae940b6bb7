#include "colmap_lazyloc/refinement/linear_projection.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

const Eigen::Vector3d kPointInWorld(0.3, -0.2, 0.5);

// A camera that observes a point, displaced by some pixels.
struct ObservingCamera {
  Rigid3d cam_from_world = LookAt({1, -2, -6}, {0.1, 0, 0.2});
  Observation observation = ObserveAt(cam_from_world * kPointInWorld, /*focal_length_px=*/500, {3, -4});
};

TEST(LinearProjection, ErrorIsTheReprojectionError) {
  const ObservingCamera camera;
  const Eigen::Vector3d point_in_cam = camera.cam_from_world * kPointInWorld;
  const Eigen::Vector2d expected = ReprojectionError(camera.observation, point_in_cam);
  Eigen::Matrix<double, 2, 3> jacobian;
  EXPECT_LE((ProjectionInCam(camera.observation).Error(point_in_cam, &jacobian) - expected).norm(), 1e-9);
  const LinearProjection in_world = ProjectionInWorld(camera.observation, camera.cam_from_world);
  EXPECT_LE((in_world.Error(kPointInWorld, &jacobian) - expected).norm(), 1e-9);
  EXPECT_LE((in_world.Scaled(2).Error(kPointInWorld, &jacobian) - 2 * expected).norm(), 1e-9);
}

TEST(LinearProjection, JacobianByThePoint) {
  const ObservingCamera camera;
  const LinearProjection projection = ProjectionInWorld(camera.observation, camera.cam_from_world);
  Eigen::Matrix<double, 2, 3> jacobian;
  projection.Error(kPointInWorld, &jacobian);
  const auto error = [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
    Eigen::Matrix<double, 2, 3> unused;
    return projection.Error(kPointInWorld + Eigen::Vector3d(step), &unused);
  };
  ExpectJacobian(error, jacobian);
}

TEST(LinearProjection, DerivativeByTheLogOfTheOffset) {
  const ObservingCamera camera;
  const LinearProjection projection = ProjectionInWorld(camera.observation, camera.cam_from_world);
  Eigen::Matrix<double, 2, 3> unused;
  const auto error = [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
    return projection.WithOffset(std::exp(step[0])).Error(kPointInWorld, &unused);
  };
  ExpectJacobian(error, projection.DerivativeByLogOffset(kPointInWorld, projection.Error(kPointInWorld, &unused)));
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/refinement/rig_tolerance.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

// Holds the poses of an image, its frame and its calibration, and the rig's scale. The image is where they put it.
struct Poses {
  Rigid3d cam, frame, calibration;
  double log_scale = std::log(1.5);
};

Poses MakePoses() {
  Random random(3);
  const Rigid3d frame{RandomRotation(&random), RandomVector(&random)};
  const Rigid3d calibration{RandomRotation(&random), RandomVector(&random)};
  Poses poses{{}, frame, calibration};
  poses.cam = Rigid3d{calibration.rotation, std::exp(poses.log_scale) * calibration.translation} * frame;
  return poses;
}

RigToleranceResidual Evaluate(const Poses& poses) {
  Calibration calibration;
  calibration.flex_rad = 0.01;
  calibration.flex_length = 0.2;
  return EvaluateRigTolerance(calibration, poses.calibration, poses.log_scale, poses.cam, poses.frame);
}

TEST(EvaluateRigTolerance, IsZeroForARigidRig) { EXPECT_LE(Evaluate(MakePoses()).error.norm(), 1e-12); }

TEST(EvaluateRigTolerance, CountsStandardDeviations) {
  Poses poses = MakePoses();
  poses.cam.rotation = ExpSO3({0, 0.02, 0}) * poses.cam.rotation;
  poses.cam.translation = ExpSO3({0, 0.02, 0}) * poses.cam.translation;
  EXPECT_NEAR(Evaluate(poses).error.norm(), 2, 1e-9) << "turns about its centre";
  poses = MakePoses();
  poses.cam.translation.x() += 0.6;
  EXPECT_NEAR(Evaluate(poses).error.norm(), 3, 1e-9);
}

TEST(EvaluateRigTolerance, JacobiansAreThoseOfTheTangents) {
  const Poses poses = MakePoses();
  const RigToleranceResidual residual = Evaluate(poses);
  const auto expect_jacobian = [&](Rigid3d Poses::*pose, const Eigen::Matrix<double, 6, 6>& jacobian) {
    ExpectJacobian(
        [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
          Poses moved = poses;
          Rigid3d& target = moved.*pose;
          target.rotation = ExpSO3(step.head<3>()) * target.rotation;
          target.translation += step.tail<3>();
          return Evaluate(moved).error;
        },
        jacobian);
  };
  expect_jacobian(&Poses::cam, residual.by_cam.leftCols<6>());
  expect_jacobian(&Poses::frame, residual.by_frame.leftCols<6>());
  expect_jacobian(&Poses::calibration, residual.by_calibration.leftCols<6>());
  ExpectJacobian(
      [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
        Poses moved = poses;
        moved.log_scale += step[0];
        return Evaluate(moved).error;
      },
      residual.by_frame.col(6));
}

}  // namespace
}  // namespace lazyloc

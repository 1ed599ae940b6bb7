#include "colmap_lazyloc/refinement/pose_prior.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500;

TEST(PosePrior, JacobianIsTheDerivative) {
  Random random(1);
  const Rigid3d given = LookAt({1, 2, -8}, {0, 0, 0});
  const PosePrior prior{given, 0.01, 0.2};
  const Rigid3d pose{Disturbed(given.rotation, 0.05, &random), given.translation + 0.3 * RandomVector(&random)};
  const PosePriorResidual residual = EvaluatePosePrior(prior, pose);
  const auto error = [&](const Eigen::VectorXd& move) -> Eigen::VectorXd {
    const Eigen::Quaterniond rotation = ExpSO3(Eigen::Vector3d(move.head<3>())) * pose.rotation;
    return EvaluatePosePrior(prior, {rotation, pose.translation + move.tail<3>()}).error;
  };
  // Allows for terms of second order in the rotation's deviation, which is about 1e-3 rad.
  ExpectJacobian(error, residual.jacobian, /*step=*/1e-6, /*tolerance=*/2e-3);
}

TEST(PosePrior, ScalesAreFocalLengthAndDistance) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  const std::vector<FrameScale> scales = MeasureFrameScales(scene.posed, scene.tracks);
  ASSERT_EQ(scales.size(), scene.posed.frames.size());
  for (size_t frame = 0; frame < scales.size(); ++frame) {
    EXPECT_NEAR(scales[frame].focal_length_px, kFocalLengthPx, 1);
    double inverse_sum = 0;
    for (const Track& track : scene.tracks) {
      inverse_sum += 1 / (scene.posed.frames[frame].frame_from_world * track.point_in_world).norm();
    }
    EXPECT_NEAR(scales[frame].distance, static_cast<double>(scene.tracks.size()) / inverse_sum, 1e-12);
  }
  const PosePrior prior = MakePosePrior(scene.posed.frames[1].frame_from_world, 2, scales[1]);
  EXPECT_NEAR(prior.rotation_stddev_rad, 2 / kFocalLengthPx, 1e-5);
  EXPECT_NEAR(prior.position_stddev, 2 * scales[1].distance / kFocalLengthPx, 1e-4);
}

TEST(PosePrior, ScalesOfAFrameAreOverAllItsImages) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.posed.images[2].frame = 1;
  scene.posed.images[2].cam_from_frame.translation.z() = 4;
  std::vector<double> distances;
  for (const int image : {1, 2}) {
    for (const Track& track : scene.tracks) {
      distances.push_back((CamFromWorld(scene.posed, image) * track.point_in_world).norm());
    }
  }
  const std::vector<FrameScale> scales = MeasureFrameScales(scene.posed, scene.tracks);
  EXPECT_DOUBLE_EQ(scales[1].distance, HarmonicMean(distances));
  EXPECT_NEAR(scales[1].focal_length_px, kFocalLengthPx, 1);
  EXPECT_EQ(scales[2].distance, 0) << "a frame without images";
}

}  // namespace
}  // namespace lazyloc

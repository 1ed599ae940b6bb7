#include "colmap_lazyloc/group/rig_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

SyntheticGroupOptions Rig(int num_frames, int num_sensors) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = 60;
  options.pixel_noise_px = 0.5;
  return options;
}

StageInput MakeInput(const SyntheticGroupOptions& options) { return MakeStageInput(MakeSyntheticGroup(options)); }

// Turns an image on its rig by 10 deg, in the poses but not in the tracks.
void Turn(int image, PosedImages* posed) {
  Random random(3);
  Eigen::Quaterniond& rotation = posed->images[image].cam_from_frame.rotation;
  rotation = Disturbed(rotation, 10, &random);
}

TEST(CheckRigs, RightCalibrationHasSmallErrors) {
  const StageInput input = MakeInput(Rig(2, 3));
  const std::vector<std::optional<double>> errors_px = CheckRigs(input.layout, input.truth, input.tracks, {});
  ASSERT_EQ(errors_px.size(), 6u);
  for (const std::optional<double>& error_px : errors_px) {
    ASSERT_TRUE(error_px);
    EXPECT_GT(*error_px, 0.2);  // the median length of 0.5 px of noise in two coordinates is 0.59 px
    EXPECT_LT(*error_px, 1);
  }
}

TEST(CheckRigs, TurnedImageIsNamed) {
  StageInput input = MakeInput(Rig(3, 3));
  Turn(4, &input.truth);
  const Failure failure = FailureOf([&] { CheckRigs(input.layout, input.truth, input.tracks, {}); });
  EXPECT_EQ(failure.cause, QueryStatus::INCONSISTENT_RIG);
  EXPECT_THAT(failure.frames, ElementsAre(1));
  EXPECT_THAT(failure.reason, HasSubstr("image query1-1 does not fit"));
  ASSERT_EQ(failure.rig_errors_px.size(), 9u);
  for (int query = 0; query < 9; ++query) {
    if (query == 5) continue;  // the check of a frame ends at the first wrong image
    ASSERT_TRUE(failure.rig_errors_px[query]);
    if (query == 4) {
      EXPECT_GT(*failure.rig_errors_px[query], 30);
    } else {
      EXPECT_LT(*failure.rig_errors_px[query], 1);
    }
  }
}

TEST(CheckRigs, SmallErrorOfCalibrationIsAccepted) {
  SyntheticGroupOptions options = Rig(1, 2);
  options.calibration_error_deg = 0.5;  // 7 px
  const StageInput input = MakeInput(options);
  const std::vector<std::optional<double>> errors_px = CheckRigs(input.layout, input.truth, input.tracks, {});
  EXPECT_LT(*errors_px[0], 1);
  EXPECT_GT(*errors_px[1], 3);
}

TEST(CheckRigs, TooFewPointsProveNothing) {
  StageInput input = MakeInput(Rig(1, 2));
  Turn(1, &input.truth);
  input.tracks.resize(60 + 11);  // 60 of image 0, 11 of image 1: fewer than twice min_num_tracks
  EXPECT_GT(*CheckRigs(input.layout, input.truth, input.tracks, {})[1], 30);
  input.tracks.resize(60);
  EXPECT_FALSE(CheckRigs(input.layout, input.truth, input.tracks, {})[1].has_value());
}

// Displaces all points of an image: they fit no pose of it, so that the calibration is not to blame.
TEST(CheckRigs, WrongPointsProveNothing) {
  StageInput input = MakeInput(Rig(1, 2));
  Random random(1);
  for (Track& track : input.tracks) {
    if (track.observations.front().image == 1) track.point_in_world = 2 * RandomVector(&random);
  }
  EXPECT_GT(*CheckRigs(input.layout, input.truth, input.tracks, {})[1], 30);
}

TEST(CheckRigs, LoneImagesHaveNoErrors) {
  StageInput input = MakeInput(Rig(3, 1));
  for (int frame = 0; frame < 3; ++frame) input.truth.frames[frame].frame_from_world = Rigid3d();
  EXPECT_THAT(CheckRigs(input.layout, input.truth, input.tracks, {}), Each(std::nullopt));
}

// Returns the deviations of the pairs' rotations from those of the poses.
std::vector<double> RotationErrorsRad(const StageInput& input) {
  std::vector<double> errors_rad;
  for (const PairGeometry& pair : input.pairs) {
    const Rigid3d query = CamFromWorld(input.truth, pair.query), other = CamFromWorld(input.truth, pair.other);
    errors_rad.push_back(AngularDistanceRad(query.rotation, pair.query_from_other.rotation * other.rotation));
  }
  return errors_rad;
}

void CheckRotations(const StageInput& input) {
  CheckRigRotations(input.layout, Refs(input.pairs), RotationErrorsRad(input), /*max_error_deg=*/5);
}

TEST(CheckRigRotations, RightCalibrationPasses) { EXPECT_NO_THROW(CheckRotations(MakeInput(Rig(2, 3)))); }

TEST(CheckRigRotations, TurnedImageIsNamed) {
  StageInput input = MakeInput(Rig(3, 3));
  Turn(5, &input.truth);
  const Failure failure = FailureOf([&] { CheckRotations(input); });
  EXPECT_EQ(failure.cause, QueryStatus::INCONSISTENT_RIG);
  EXPECT_THAT(failure.frames, ElementsAre(1));
  EXPECT_THAT(failure.reason, HasSubstr("image query1-2 does not fit"));
}

TEST(CheckRigRotations, PairsThatContradictEachOtherProveNothing) {
  StageInput input = MakeInput(Rig(1, 2));
  Random random(1);
  for (PairGeometry& pair : input.pairs) {
    if (pair.query == 1) pair.query_from_other.rotation = RandomRotation(&random);
  }
  EXPECT_NO_THROW(CheckRotations(input));
}

TEST(CheckRigRotations, LoneImagesPass) {
  StageInput input = MakeInput(Rig(2, 1));
  input.truth.frames[0].frame_from_world.rotation = Eigen::Quaterniond(0, 1, 0, 0);
  EXPECT_NO_THROW(CheckRotations(input));
}

}  // namespace
}  // namespace lazyloc

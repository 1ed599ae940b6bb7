#include "colmap_lazyloc/pipeline/refinement_without_tracks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

// A single query with an averaged pose that is off by one degree and 0.1.
struct Input {
  SyntheticGroup scene;
  StageInput stages;
  Averaged averaged;

  PosedImages Refine(PostOptimization method) const {
    LocalizerOptions options;
    options.post_optimization = method;
    return RefineWithoutTracks(scene.group, stages.layout, averaged, options);
  }
};

Input MakeInput() {
  SyntheticGroupOptions options;
  options.num_sensors = 1;
  options.num_points = 60;
  Input input;
  input.scene = MakeSyntheticGroup(options);
  input.stages = MakeStageInput(input.scene);
  input.averaged.posed = input.stages.truth;
  Random random(1);
  Rigid3d& pose = input.averaged.posed.frames[0].frame_from_world;
  pose = DisturbedPose(pose, 1, 0.1, &random);
  return input;
}

class MethodsWithoutTracks : public testing::TestWithParam<PostOptimization> {};

TEST_P(MethodsWithoutTracks, NoiseFreeIsExact) {
  Input input = MakeInput();
  input.averaged.pairs = Refs(input.stages.pairs);
  const PosedImages refined = input.Refine(GetParam());
  ExpectNear(refined, input.stages.truth, 1e-4, 1e-3);
  ExpectSameDatabasePoses(refined, input.stages.layout.given);
}

TEST_P(MethodsWithoutTracks, NoPairsAreAFailure) {
  const Input input = MakeInput();
  const Failure failure = FailureOf([&] { input.Refine(GetParam()); });
  EXPECT_EQ(failure.cause, QueryStatus::DIVERGED);
  EXPECT_FALSE(failure.reason.empty());
}

INSTANTIATE_TEST_SUITE_P(RefineWithoutTracks, MethodsWithoutTracks,
                         testing::Values(PostOptimization::SAMPSON, PostOptimization::RELATIVE_POSE_LO));

TEST(RefineWithoutTracks, NoneKeepsTheAveragedPose) {
  Input input = MakeInput();
  input.averaged.pairs = Refs(input.stages.pairs);
  ExpectSameBits(input.Refine(PostOptimization::NONE).frames[0].frame_from_world,
                 input.averaged.posed.frames[0].frame_from_world);
}

}  // namespace
}  // namespace lazyloc

#include "ablation.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

AblatedResult Localize(const std::string& name, const SyntheticScene& scene) {
  return LocalizeByAblation(name, LoneQuery(scene), {});
}

TEST(Ablation, EachIsExactWithoutNoise) {
  const SyntheticScene scene = MakeSyntheticScene({});
  for (const std::string& name : AblationNames()) {
    const AblatedResult result = Localize(name, scene);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << name;
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 1e-6 * scene.median_depth) << name;
  }
}

TEST(Ablation, NoneIsTheMethodOfTheProgram) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = options.rotation_noise_deg = options.direction_noise_deg = 1;
  const SyntheticScene scene = MakeSyntheticScene(options);
  LocalizerOptions paper;
  paper.method = Method::PAPER;
  ExpectSameBits(Localize("none", scene).cam_from_world, LocalizeQuery(scene.problem, paper).cam_from_world);
}

TEST(Ablation, TracksAreBetterThanNoPostOptimization) {
  SyntheticSceneOptions options;
  options.num_database_images = 10;
  options.pixel_noise_px = options.rotation_noise_deg = options.direction_noise_deg = 1;
  double with = 0, without = 0;
  for (options.seed = 0; options.seed < 10; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    with += PositionError(Localize("none", scene).cam_from_world, scene.query_cam_from_world);
    without += PositionError(Localize("averaging_alone", scene).cam_from_world, scene.query_cam_from_world);
  }
  EXPECT_LT(with, 0.8 * without);
}

TEST(Ablation, FailuresAreStatuses) {
  SyntheticSceneOptions options;
  options.outlier_pair_ratio = 1;
  EXPECT_EQ(Localize("sampson", MakeSyntheticScene(options)).status, QueryStatus::INCONSISTENT_ROTATIONS);
  EXPECT_THROW(Localize("median", MakeSyntheticScene({})), InputError);
}

}  // namespace
}  // namespace lazyloc

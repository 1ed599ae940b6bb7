#include "colmap_lazyloc/priors/query_priors.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

constexpr double kStddev = 0.3;

SyntheticSceneOptions Noisy(SceneLayout layout, int num_database_images, uint32_t seed) {
  SyntheticSceneOptions options;
  options.layout = layout;
  options.num_database_images = num_database_images;
  options.pixel_noise_px = 0.5;
  options.seed = seed;
  return options;
}

// Gives the query a position that is off by num_sigma of its standard deviations in a random direction.
void AddPosition(double num_sigma, SyntheticScene* scene, double stddev = kStddev) {
  Random random(1);
  scene->problem.prior.position = {
      CamInWorld(scene->query_cam_from_world) + num_sigma * stddev * RandomVector(&random).normalized(),
      stddev * stddev * Eigen::Matrix3d::Identity()};
}

// Gives the query a direction of gravity that is off by an angle.
void AddGravity(double angle_deg, double stddev_deg, SyntheticScene* scene) {
  Random random(2);
  const Eigen::Vector3d down_in_world(0, 0, -1);
  const Eigen::Vector3d down_in_cam = scene->query_cam_from_world.rotation * down_in_world;
  scene->problem.prior.gravity = {DisturbedDirection(down_in_cam, angle_deg, &random), down_in_world,
                                  DegToRad(stddev_deg)};
}

double PositionSigma(const LocalizationResult& result, const SyntheticScene& scene) {
  const Eigen::Vector3d error = CamInWorld(result.cam_from_world) - CamInWorld(scene.query_cam_from_world);
  return std::sqrt(error.dot(
      MakePoseDistribution(result.cam_from_world, result.covariance).PositionCovariance().ldlt().solve(error)));
}

// Expects a pose whose position a prior fixes, within four standard deviations.
void ExpectFixed(const SyntheticScene& scene, PriorRole role) {
  const LocalizationResult result = LocalizeQuery(scene.problem, WithExactDatabase());
  ASSERT_TRUE(HasPose(result.status)) << result.reason;
  EXPECT_EQ(result.priors.position->verdict, PriorVerdict::USED);
  EXPECT_EQ(result.priors.position->fixes, role) << EnumName(result.priors.position->fixes);
  EXPECT_LE(PositionSigma(result, scene), 4);
  EXPECT_NEAR(result.spread.position_stddevs[0], kStddev, 0.1 * kStddev);
  EXPECT_LE(AngularDistanceRad(result.cam_from_world.rotation, scene.query_cam_from_world.rotation),
            4 * result.spread.rotation_stddev_rad);
}

TEST(QueryPriors, PositionFixesTheDistanceFromOneImage) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    SyntheticSceneOptions options = Noisy(SceneLayout::RING, 1, seed);
    options.origin = {500000, 5400000, 300};
    SyntheticScene scene = MakeSyntheticScene(options);
    AddPosition(1, &scene);
    ExpectFixed(scene, PriorRole::DISTANCE);
  }
}

TEST(QueryPriors, PositionFixesThePlaceOnALine) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::LINE_ON_LINE, 7, seed));
    for (size_t i = 0; i < scene.problem.pairs.size(); ++i) {
      Matches kept;
      for (const Match& match : scene.problem.pairs[i].geometry->inlier_matches) {
        if (match.query_point % scene.problem.pairs.size() == i) kept.push_back(match);
      }
      scene.problem.pairs[i].geometry->inlier_matches = kept;
    }
    AddPosition(1, &scene);
    ExpectFixed(scene, PriorRole::DISTANCE);
  }
}

TEST(QueryPriors, PositionFixesAPanorama) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::PURE_ROTATION, 5, seed));
    AddPosition(1, &scene);
    AddGravity(0.5, 1, &scene);
    ExpectFixed(scene, PriorRole::POSITION);
  }
}

TEST(QueryPriors, GravityAloneFixesNoPosition) {
  SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::RING, 1, 0));
  AddGravity(0, 1, &scene);
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  EXPECT_EQ(result.status, QueryStatus::SCALE_UNOBSERVABLE);
  EXPECT_EQ(result.priors.gravity->verdict, PriorVerdict::NOT_TESTED);
  EXPECT_FALSE(result.priors.position);
}

// A query whose refined pose keeps no track is refused; its priors are compared with nothing.
TEST(QueryPriors, NothingIsComparedWithAPoseWithoutTracks) {
  SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::RING, 6, 0));
  AddPosition(1, &scene);
  AddGravity(1, 1, &scene);
  const Layout layout = MakeLayout(LoneQuery(scene));
  Refined refined;
  refined.adjustment.posed = layout.given;
  const PriorJudgement judgement = JudgePriors(layout, {}, refined, {});
  EXPECT_TRUE(judgement.used.empty());
  EXPECT_EQ(judgement.results[0].position->verdict, PriorVerdict::NOT_TESTED);
  EXPECT_EQ(judgement.results[0].gravity->verdict, PriorVerdict::NOT_TESTED);
}

// Expects that priors off by ten standard deviations change no bit of the pose.
TEST(QueryPriors, ContradictedPriorsAreLeftOut) {
  for (const SceneLayout layout : {SceneLayout::RING, SceneLayout::LINE, SceneLayout::FORWARD}) {
    for (const double stddev : {0.02, 0.3, 5.0}) {
      SyntheticScene scene = MakeSyntheticScene(Noisy(layout, 6, 0));
      const LocalizationResult without = LocalizeQuery(scene.problem, {});
      ASSERT_TRUE(HasPose(without.status)) << without.reason;
      AddPosition(10, &scene, stddev);
      AddGravity(10, 1, &scene);
      const LocalizationResult result = LocalizeQuery(scene.problem, {});
      EXPECT_EQ(result.cam_from_world.translation, without.cam_from_world.translation);
      EXPECT_EQ(result.cam_from_world.rotation.coeffs(), without.cam_from_world.rotation.coeffs());
      EXPECT_EQ(result.covariance, without.covariance);
      for (const auto& prior : {*result.priors.position, *result.priors.gravity}) {
        EXPECT_EQ(prior.verdict, PriorVerdict::CONTRADICTED);
        EXPECT_GE(prior.deviation_sigma, 5);
      }
    }
  }
}

TEST(QueryPriors, AgreeingPriorsMakeAPoseMoreCertain) {
  SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::RING, 6, 0));
  const LocalizationResult without = LocalizeQuery(scene.problem, WithExactDatabase());
  ASSERT_TRUE(HasPose(without.status)) << without.reason;
  AddPosition(1, &scene, without.spread.position_stddevs[0]);
  AddGravity(0, RadToDeg(without.spread.rotation_stddev_rad), &scene);
  const LocalizationResult with = LocalizeQuery(scene.problem, WithExactDatabase());
  EXPECT_EQ(with.priors.position->verdict, PriorVerdict::USED);
  EXPECT_EQ(with.priors.position->fixes, PriorRole::NOTHING);
  EXPECT_EQ(with.priors.gravity->verdict, PriorVerdict::USED);
  EXPECT_LT(with.spread.position_stddevs[0], 0.9 * without.spread.position_stddevs[0]);
  EXPECT_LE(PositionSigma(with, scene), 4);
}

// A suspicious position, between the quantiles, counts as less certain than it says.
TEST(QueryPriors, SuspiciousPositionsHaveLessInfluence) {
  SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::RING, 6, 0));
  const LocalizationResult without = LocalizeQuery(scene.problem, WithExactDatabase());
  ASSERT_TRUE(HasPose(without.status)) << without.reason;
  const double stddev = 2 * without.spread.position_stddevs[0];
  AddPosition(0, &scene, stddev);
  const LocalizationResult agreeing = LocalizeQuery(scene.problem, WithExactDatabase());
  AddPosition(3.6, &scene, stddev);
  const LocalizationResult suspicious = LocalizeQuery(scene.problem, WithExactDatabase());
  ASSERT_EQ(suspicious.priors.position->verdict, PriorVerdict::USED);
  ASSERT_GT(suspicious.priors.position->deviation_sigma, 2.9);
  EXPECT_GT(suspicious.spread.position_stddevs[0], agreeing.spread.position_stddevs[0]);
  EXPECT_LT(suspicious.spread.position_stddevs[0], without.spread.position_stddevs[0]);
}

// Gives the second image of a rig a position; the frame is as certain as that.
TEST(QueryPriors, PositionOfAnImageOfARigMovesItsFrame) {
  SyntheticGroupOptions options;
  options.num_frames = 1;
  options.num_sensors = 2;
  options.pixel_noise_px = 0.5;
  SyntheticGroup scene = MakeSyntheticGroup(options);
  const std::vector<LocalizationResult> without = LocalizeGroup(scene.group, WithExactDatabase());
  ASSERT_TRUE(HasPose(without[1].status)) << without[1].reason;
  const double stddev = 0.3 * without[1].spread.position_stddevs[2];
  scene.group.images[1].problem.prior.position = {CamInWorld(without[1].cam_from_world),
                                                  stddev * stddev * Eigen::Matrix3d::Identity()};
  const std::vector<LocalizationResult> with = LocalizeGroup(scene.group, WithExactDatabase());
  EXPECT_EQ(with[1].priors.position->verdict, PriorVerdict::USED);
  EXPECT_FALSE(with[0].priors.position);
  EXPECT_LE(with[1].spread.position_stddevs[0], 1.01 * stddev);
  EXPECT_LT(with[0].spread.position_stddevs[0], without[0].spread.position_stddevs[0]);
}

}  // namespace
}  // namespace lazyloc

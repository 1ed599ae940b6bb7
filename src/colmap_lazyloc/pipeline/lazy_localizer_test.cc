#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

LocalizationResult Localize(const SyntheticScene& scene) { return LocalizeQuery(scene.problem, LocalizerOptions()); }

class Layouts : public testing::TestWithParam<SceneLayout> {};

TEST_P(Layouts, NoiseFreeIsExact) {
  SyntheticSceneOptions options;
  options.layout = GetParam();
  for (options.seed = 0; options.seed < 5; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = Localize(scene);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason << ", seed " << options.seed;
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 1e-8 * scene.median_depth);
    EXPECT_LE(RotationErrorDeg(result.cam_from_world, scene.query_cam_from_world), 1e-6);
    EXPECT_LE(result.mean_reprojection_error_px, 1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(LazyLocalizer, Layouts,
                         testing::Values(SceneLayout::RING, SceneLayout::LINE, SceneLayout::LINE_ON_LINE,
                                         SceneLayout::FORWARD, SceneLayout::SAME_PLACE));

// Uses 40 % gross outlier pairs, 10 % false matches, and noise of 1 deg and 1 px. The expected error is about 0.1 % of
// the depth, with 200 points in 12 good images; the bound is five times that.
TEST(LazyLocalizer, WithNoiseAndOutliers) {
  SyntheticSceneOptions options;
  options.num_database_images = 20;
  options.outlier_pair_ratio = 0.4;
  options.outlier_match_ratio = 0.1;
  options.pixel_noise_px = 1;
  options.rotation_noise_deg = 1;
  options.direction_noise_deg = 1;
  LocalizerOptions with_outliers;
  with_outliers.min_confidence = 0.5;  // because the outlier pairs hold more than a third of the matches
  for (options.seed = 0; options.seed < 10; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = LocalizeQuery(scene.problem, with_outliers);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 5e-3 * scene.median_depth);
    EXPECT_LE(RotationErrorDeg(result.cam_from_world, scene.query_cam_from_world), 0.2);
  }
}

TEST(LazyLocalizer, EstimatesGeometryFromRawMatches) {
  SyntheticSceneOptions options;
  options.has_geometry = false;
  options.pixel_noise_px = 0.5;
  options.outlier_match_ratio = 0.3;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const LocalizationResult result = Localize(scene);
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 5e-3 * scene.median_depth);
}

TEST(LazyLocalizer, LargeCoordinatesCostNothing) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 1;
  const SyntheticScene near_zero = MakeSyntheticScene(options);
  options.origin = {500000, 5400000, 300};
  const SyntheticScene far_away = MakeSyntheticScene(options);
  const LocalizationResult near_result = Localize(near_zero), far_result = Localize(far_away);
  ASSERT_EQ(far_result.status, QueryStatus::LOCALIZED);
  const Eigen::Vector3d near_error =
      CamInWorld(near_result.cam_from_world) - CamInWorld(near_zero.query_cam_from_world);
  const Eigen::Vector3d far_error = CamInWorld(far_result.cam_from_world) - CamInWorld(far_away.query_cam_from_world);
  EXPECT_LE((near_error - far_error).norm(), 1e-6);
}

TEST(LazyLocalizer, ResultFollowsTheDatabasesUnit) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 1;
  for (const double unit : {1e-3, 1e3}) {
    options.unit = unit;
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = Localize(scene);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 5e-3 * scene.median_depth);
  }
}

TEST(LazyLocalizer, SameProblemSameBytes) {
  SyntheticSceneOptions options;
  options.has_geometry = false;
  options.pixel_noise_px = 1;
  options.outlier_match_ratio = 0.3;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const Rigid3d first = Localize(scene).cam_from_world, second = Localize(scene).cam_from_world;
  EXPECT_EQ(first.rotation.coeffs(), second.rotation.coeffs());
  EXPECT_EQ(first.translation, second.translation);
}

TEST(LazyLocalizer, ReportsPairsAndPoints) {
  SyntheticSceneOptions options;
  options.outlier_pair_ratio = 0.2;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const LocalizationResult result = Localize(scene);
  ASSERT_EQ(result.pairs.size(), scene.problem.pairs.size());
  EXPECT_TRUE(std::isnan(result.pairs.front().rotation_error_deg)) << "an outlier pair counts as used";
  EXPECT_EQ(result.pairs.back().num_inliers, options.num_points);
  EXPECT_LE(result.pairs.back().rotation_error_deg, 1e-6);
  EXPECT_EQ(result.num_tracks, options.num_points);
  EXPECT_EQ(result.num_observations, options.num_points * (1 + options.num_database_images - scene.num_outlier_pairs));
  EXPECT_EQ(result.seconds.size(), 12u);
  EXPECT_THAT(result.start, testing::AnyOf("motion_averaging", "absolute_pose"));
}

class Methods : public testing::TestWithParam<Method> {
 protected:
  LocalizationResult Localize(const SyntheticScene& scene) const {
    LocalizerOptions options;
    options.method = GetParam();
    return LocalizeQuery(scene.problem, options);
  }
};

TEST_P(Methods, NoiseFreeIsExact) {
  const SyntheticScene scene = MakeSyntheticScene({});
  const LocalizationResult result = Localize(scene);
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 1e-7 * scene.median_depth);
  EXPECT_TRUE(result.covariance.allFinite());
  EXPECT_EQ(result.points.size(), scene.problem.query_keypoints.size());
}

// Has 200 points in 12 good images, which leave about 0.1 % of the depth; the bound is five times that.
TEST_P(Methods, WithNoiseAndFalseMatches) {
  SyntheticSceneOptions options;
  options.num_database_images = 12;
  options.outlier_match_ratio = 0.1;
  options.pixel_noise_px = options.rotation_noise_deg = options.direction_noise_deg = 1;
  for (options.seed = 0; options.seed < 5; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = Localize(scene);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 5e-3 * scene.median_depth);
  }
}

INSTANTIATE_TEST_SUITE_P(LazyLocalizer, Methods, testing::Values(Method::EXTENDED, Method::PAPER),
                         [](const auto& method) { return std::string(EnumName(method.param)); });

TEST(LazyLocalizer, PaperNeitherUsesPriorsNorChecksIntrinsics) {
  SyntheticSceneOptions scene_options;
  scene_options.pixel_noise_px = 1;
  SyntheticScene scene = MakeSyntheticScene(scene_options);
  LocalizerOptions options;
  options.method = Method::PAPER;
  const LocalizationResult without = LocalizeQuery(scene.problem, options);
  scene.problem.prior.position.emplace().position = CamInWorld(scene.query_cam_from_world);
  const LocalizationResult with = LocalizeQuery(scene.problem, options);
  ASSERT_EQ(with.status, QueryStatus::LOCALIZED) << with.reason;
  EXPECT_EQ(with.cam_from_world.translation, without.cam_from_world.translation);
  EXPECT_EQ(with.priors.position->verdict, PriorVerdict::NOT_TESTED);
  EXPECT_EQ(with.start, "motion_averaging");
  EXPECT_FALSE(with.is_camera_refined);
}

TEST(LazyLocalizer, AbsolutePoseIsUsedIfRotationsContradictEachOther) {
  SyntheticScene scene = MakeSyntheticScene({});
  Random random(7);
  for (ImagePair& pair : scene.problem.pairs) {  // right matches, but wrong relative poses
    pair.geometry->query_from_other->rotation = RandomRotation(&random);
  }
  const LocalizationResult result = Localize(scene);
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_EQ(result.start, "absolute_pose");
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 1e-6 * scene.median_depth);
}

TEST(LazyLocalizer, DatabasePosesThatAreOffAreCorrectedForTheQuery) {
  SyntheticSceneOptions scene_options;
  scene_options.num_database_images = 12;
  scene_options.pixel_noise_px = 0.5;
  LocalizerOptions exact;
  exact.database_pose_stddev_deg = exact.database_pose_stddev_length = 0;
  double exact_sum = 0, estimated_sum = 0;
  for (scene_options.seed = 0; scene_options.seed < 10; ++scene_options.seed) {
    SyntheticScene scene = MakeSyntheticScene(scene_options);
    Random random(scene_options.seed);
    for (ImagePair& pair : scene.problem.pairs) {
      Rigid3d& pose = pair.database_cam_from_world;
      const Eigen::Vector3d cam_in_world = CamInWorld(pose) + 0.004 * scene.median_depth * RandomVector(&random);
      pose = CamFromWorld(Disturbed(pose.rotation, 0.4, &random), cam_in_world);
    }
    const LocalizationResult estimated = Localize(scene), taken_as_exact = LocalizeQuery(scene.problem, exact);
    ASSERT_TRUE(HasPose(estimated.status)) << estimated.reason;
    ASSERT_TRUE(HasPose(taken_as_exact.status)) << taken_as_exact.reason;
    estimated_sum += PositionError(estimated.cam_from_world, scene.query_cam_from_world);
    exact_sum += PositionError(taken_as_exact.cam_from_world, scene.query_cam_from_world);
  }
  EXPECT_LE(estimated_sum, 0.95 * exact_sum);
}

// Checks that points which are off as far as the database poses are no outliers of a query without noise of its own.
TEST(LazyLocalizer, DatabasePosesThatAreOffLeaveThePointsOfAPreciseQuery) {
  SyntheticSceneOptions scene_options;
  scene_options.num_database_images = 12;
  scene_options.pixel_noise_px = 0.5;
  SyntheticScene scene = MakeSyntheticScene(scene_options);
  Random random(0);
  for (ImagePair& pair : scene.problem.pairs) {
    Rigid3d& pose = pair.database_cam_from_world;
    const Eigen::Quaterniond rotation = Disturbed(pose.rotation, 0.4, &random);
    pose = CamFromWorld(rotation, CamInWorld(pose) + 0.004 * scene.median_depth * RandomVector(&random));
  }
  const LocalizationResult result = Localize(scene);
  ASSERT_TRUE(HasPose(result.status)) << result.reason;
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.01 * scene.median_depth);
}

TEST(LazyLocalizer, ImpossibleOptionsAreNamed) {
  const SyntheticScene scene = MakeSyntheticScene({});
  const auto error = [&](const LocalizerOptions& options) {
    try {
      LocalizeQuery(scene.problem, options);
    } catch (const InputError& input_error) {
      return std::string(input_error.what());
    }
    return std::string();
  };
  LocalizerOptions options;
  EXPECT_EQ(error(options), "");
  options.bundle_adjustment.max_num_iterations = -1;
  EXPECT_EQ(error(options), "max_num_iterations must be >= 0, but is -1");
  options = {};
  options.triangulation.max_query_error_sigma = 0;
  EXPECT_EQ(error(options), "max_query_error_sigma must be > 0, but is 0");
  options = {};
  options.max_position_stddev_ratio = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(error(options), "max_position_stddev_ratio must be > 0, but is nan");
}

TEST(LazyLocalizer, NoKeypointsIsReported) {
  SyntheticScene scene = MakeSyntheticScene({});
  scene.problem.query_keypoints.clear();
  EXPECT_EQ(Localize(scene).status, QueryStatus::NO_FEATURES);
}

TEST(LazyLocalizer, NoPairsIsReported) {
  SyntheticScene scene = MakeSyntheticScene({});
  scene.problem.pairs.clear();
  const LocalizationResult result = Localize(scene);
  EXPECT_EQ(result.status, QueryStatus::NO_PAIRS);
  EXPECT_THAT(result.reason, testing::HasSubstr("no posed database image"));
}

TEST(LazyLocalizer, TooFewInliersIsReported) {
  SyntheticSceneOptions options;
  options.num_points = 12;
  EXPECT_EQ(Localize(MakeSyntheticScene(options)).status, QueryStatus::TOO_FEW_INLIERS);
}

TEST(LazyLocalizer, ContradictingPairsAreReported) {
  SyntheticSceneOptions options;
  options.outlier_pair_ratio = 1;
  EXPECT_EQ(Localize(MakeSyntheticScene(options)).status, QueryStatus::INCONSISTENT_ROTATIONS);
}

TEST(LazyLocalizer, OnePairLeavesScaleUnobservable) {
  SyntheticSceneOptions options;
  options.num_database_images = 1;
  for (options.pixel_noise_px = 0; options.pixel_noise_px < 3; ++options.pixel_noise_px) {
    EXPECT_EQ(Localize(MakeSyntheticScene(options)).status, QueryStatus::SCALE_UNOBSERVABLE);
  }
}

TEST(LazyLocalizer, PureRotationIsReported) {
  SyntheticSceneOptions options;
  options.layout = SceneLayout::PURE_ROTATION;
  for (options.pixel_noise_px = 0; options.pixel_noise_px < 3; ++options.pixel_noise_px) {
    const LocalizationResult result = Localize(MakeSyntheticScene(options));
    EXPECT_TRUE(result.status == QueryStatus::DEGENERATE_BASELINE || result.status == QueryStatus::TOO_FEW_TRACKS ||
                result.status == QueryStatus::SCALE_UNOBSERVABLE)
        << QueryStatusName(result.status);
    EXPECT_FALSE(result.reason.empty());
  }
}

TEST(LazyLocalizer, CovarianceMatchesTheErrorsSpread) {
  // Expects 6, the degrees of freedom, as the mean of the squared errors normalised by their covariances. The standard
  // deviation of the mean is sqrt(12 / 40) = 0.55, and robust weights cost a little.
  SyntheticSceneOptions options;
  options.pixel_noise_px = 1;
  double sum = 0;
  const int num_trials = 40;
  for (options.seed = 0; options.seed < num_trials; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = LocalizeQuery(scene.problem, WithExactDatabase());
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED);
    const Rigid3d& truth = scene.query_cam_from_world;
    Eigen::Matrix<double, 6, 1> error;
    const Eigen::AngleAxisd rotation_error(truth.rotation * result.cam_from_world.rotation.conjugate());
    error << rotation_error.angle() * rotation_error.axis(), truth.translation - result.cam_from_world.translation;
    sum += error.dot(result.covariance.ldlt().solve(error));
  }
  EXPECT_GT(sum / num_trials, 4);
  EXPECT_LT(sum / num_trials, 9);
}

TEST(LocalizerOptions, DefaultsPassAndBadOnesAreNamed) {
  std::string error;
  EXPECT_TRUE(LocalizerOptions().Check(&error));
  LocalizerOptions options;
  options.rig_noise_px = -1;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_EQ(error, "rig_noise_px must be >= 0, but is -1");
  options = {};
  options.min_confidence = 2;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_EQ(error, "min_confidence must be <= 1, but is 2");
}

// Returns a scene of two database images, of which one pair has a wrong relative rotation and fewer inliers, as a pair
// with the wrong orientation of a plane has.
SyntheticScene MakeContradictoryScene() {
  SyntheticSceneOptions options;
  options.num_database_images = 2;
  options.pixel_noise_px = 0.3;
  SyntheticScene scene = MakeSyntheticScene(options);
  TwoViewGeometry& wrong = *scene.problem.pairs[1].geometry;
  Random random(4);
  wrong.query_from_other->rotation = Disturbed(wrong.query_from_other->rotation, 12, &random);
  wrong.inlier_matches.resize(wrong.inlier_matches.size() - 20);
  return scene;
}

TEST(LocalizeQuery, PointsOfTwoImagesLocalizeAQueryWhosePairsContradictEachOther) {
  const SyntheticScene scene = MakeContradictoryScene();
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.05);
  EXPECT_EQ(result.start, EnumName(StartPose::ABSOLUTE_POSE));
}

// The points tell more than a position from which the query would be put on the ray of one pair.
TEST(LocalizeQuery, PointsOfTwoImagesPrecedeAPosition) {
  SyntheticScene scene = MakeContradictoryScene();
  scene.problem.prior.position = {CamInWorld(scene.query_cam_from_world) + Eigen::Vector3d(0.3, 0.3, 0),
                                  0.25 * Eigen::Matrix3d::Identity()};
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_EQ(result.priors.position->fixes, PriorRole::NOTHING);
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.05);
}

TEST(LocalizeQuery, MatchesOfContradictoryPairsLocalizeWithoutCommonPoints) {
  SyntheticScene scene = MakeContradictoryScene();
  for (size_t i = 0; i < 2; ++i) {
    Matches kept;
    for (const Match& match : scene.problem.pairs[i].geometry->inlier_matches) {
      if (match.query_point % 2 == i) kept.push_back(match);
    }
    scene.problem.pairs[i].geometry->inlier_matches = kept;
  }
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_EQ(result.start, EnumName(StartPose::GENERALIZED_RELATIVE_POSE));
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.05);
}

}  // namespace
}  // namespace lazyloc

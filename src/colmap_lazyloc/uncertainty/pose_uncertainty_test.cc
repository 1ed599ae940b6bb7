#include "colmap_lazyloc/uncertainty/pose_uncertainty.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include <gmock/gmock.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;

// Quantiles of the chi-square distribution with 6 degrees of freedom.
struct Quantile {
  double fraction, value;
};
constexpr Quantile kQuantiles[] = {{0.1, 2.204},  {0.25, 3.455}, {0.5, 5.348},
                                   {0.75, 7.841}, {0.9, 10.645}, {0.95, 12.592}};

double NormalizedSquaredError(const LocalizationResult& result, const Rigid3d& truth) {
  Eigen::Matrix<double, 6, 1> error;
  error << LogSO3(truth.rotation * result.cam_from_world.rotation.conjugate()),
      truth.translation - result.cam_from_world.translation;
  return error.dot(result.covariance.ldlt().solve(error));
}

// Moves database poses by errors that look like noise_px in the images.
void DisturbDatabase(double noise_px, SyntheticScene* scene, Random* random) {
  constexpr double kFocalLengthPx = 800;
  for (ImagePair& pair : scene->problem.pairs) {
    Rigid3d& pose = pair.database_cam_from_world;
    pose = CamFromWorld(ExpSO3(noise_px / kFocalLengthPx * RandomVector(random)) * pose.rotation,
                        CamInWorld(pose) + noise_px / kFocalLengthPx * scene->median_depth * RandomVector(random));
  }
}

// Appends the errors of 108 queries: three layouts with few and with many database images.
void AppendErrors(double pixel_noise_px, double database_noise_px, const LocalizerOptions& localizer,
                  std::vector<double>* errors) {
  SyntheticSceneOptions options;
  options.num_points = 100;
  options.pixel_noise_px = pixel_noise_px;
  for (options.seed = 0; options.seed < 18; ++options.seed) {
    Random random(options.seed);
    for (const SceneLayout layout : {SceneLayout::RING, SceneLayout::LINE, SceneLayout::FORWARD}) {
      for (const int num_database_images : {3, 8}) {
        options.layout = layout;
        options.num_database_images = num_database_images;
        SyntheticScene scene = MakeSyntheticScene(options);
        DisturbDatabase(database_noise_px, &scene, &random);
        const LocalizationResult result = LocalizeQuery(scene.problem, localizer);
        ASSERT_TRUE(HasPose(result.status)) << result.reason;
        errors->push_back(NormalizedSquaredError(result, scene.query_cam_from_world));
      }
    }
  }
}

// Returns the ratio of a quantile of the errors to that of the chi-square distribution.
double QuantileRatio(std::vector<double> errors, const Quantile& quantile) {
  std::sort(errors.begin(), errors.end());
  return errors[static_cast<size_t>(quantile.fraction * static_cast<double>(errors.size()))] / quantile.value;
}

// Detects standard deviations that are wrong by a factor of 1.5, because they move every quantile by a factor of 2.25.
// Chance moves the median of 324 queries by 5 % and the outer quantiles by 10 % (one standard deviation).
TEST(EstimateCovariance, NormalizedErrorsAreChiSquareDistributed) {
  LocalizerOptions localizer = WithExactDatabase();
  // Keeps all matches, because all are right. The usual bound would also drop some of them: those that are far from an
  // earlier pose.
  localizer.triangulation.max_query_error_sigma = 50;
  std::vector<double> errors;
  for (const double noise_px : {0.3, 1.0, 2.0}) AppendErrors(noise_px, 0, localizer, &errors);
  ASSERT_EQ(errors.size(), 324);
  for (const Quantile& quantile : kQuantiles) {
    EXPECT_GT(QuantileRatio(errors, quantile), 0.7) << quantile.fraction;
    EXPECT_LT(QuantileRatio(errors, quantile), 1.45) << quantile.fraction;
  }
}

// Checks the part of the covariance that is due to the database's noise: without it the median of the squared errors
// would be twelve times too large. The bound is far below 1, because a covariance allows for more than the estimate.
TEST(EstimateCovariance, NoiseOfTheDatabaseIsPartOfTheCovariance) {
  std::vector<double> errors;
  AppendErrors(1, 1, LocalizerOptions(), &errors);
  ASSERT_EQ(errors.size(), 108);
  EXPECT_GT(QuantileRatio(errors, kQuantiles[2]), 0.15);
  EXPECT_LT(QuantileRatio(errors, kQuantiles[2]), 2);
}

// Leaves each point a match with one database image, in turn.
void LeaveOneMatchPerPoint(SyntheticScene* scene) {
  const size_t num_pairs = scene->problem.pairs.size();
  for (size_t i = 0; i < num_pairs; ++i) {
    Matches kept;
    for (const Match& match : scene->problem.pairs[i].geometry->inlier_matches) {
      if (match.query_point % num_pairs == i) kept.push_back(match);
    }
    scene->problem.pairs[i].geometry->inlier_matches = kept;
  }
}

SyntheticSceneOptions Noisy(SceneLayout layout, int num_database_images) {
  SyntheticSceneOptions options;
  options.layout = layout;
  options.num_database_images = num_database_images;
  options.pixel_noise_px = 0.5;
  return options;
}

double BearingErrorRad(const Bearing& bearing, const SyntheticScene& scene) {
  for (const ImagePair& pair : scene.problem.pairs) {
    if (pair.other_name != bearing.database_name) continue;
    return AngleBetweenRad(bearing.dir_database_to_query_in_world,
                           CamInWorld(scene.query_cam_from_world) - CamInWorld(pair.database_cam_from_world));
  }
  ADD_FAILURE() << bearing.database_name << " is not a database image";
  return 0;
}

// Expects rotation and bearing within four standard deviations of the truth, and standard deviations as half a pixel of
// noise at a focal length of 900 px gives with 200 points.
void ExpectTruePartialPose(const LocalizationResult& result, const SyntheticScene& scene) {
  ASSERT_TRUE(result.partial_pose && result.partial_pose->bearing && result.partial_pose->rotation_stddev_rad);
  const PartialPose& partial = *result.partial_pose;
  EXPECT_LE(AngularDistanceRad(partial.cam_from_world_rotation, scene.query_cam_from_world.rotation),
            4 * *partial.rotation_stddev_rad);
  EXPECT_LE(*partial.rotation_stddev_rad, DegToRad(0.5));
  EXPECT_LE(BearingErrorRad(*partial.bearing, scene), 4 * partial.bearing->stddev_rad);
  EXPECT_LE(partial.bearing->stddev_rad, DegToRad(1));
}

TEST(EstimateCovariance, OneDatabasePositionLeavesRotationAndBearing) {
  for (uint32_t seed = 0; seed < 10; ++seed) {
    SyntheticSceneOptions options = Noisy(SceneLayout::RING, 1);
    options.seed = seed;
    options.origin = {500000, 5400000, 300};
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = LocalizeQuery(scene.problem, {});
    ASSERT_EQ(result.status, QueryStatus::SCALE_UNOBSERVABLE) << result.reason;
    EXPECT_THAT(result.reason, HasSubstr("one database position"));
    ExpectTruePartialPose(result, scene);
  }
}

// In some scenes points would lie behind a camera in the other orientation. Then the images tell.
TEST(EstimateCovariance, OneDatabasePositionBeforeAPlaneLeavesTwoOrientations) {
  SyntheticSceneOptions options = Noisy(SceneLayout::RING, 1);
  options.has_planar_points = true;
  int num_ambiguous = 0;
  for (options.seed = 0; options.seed < 10; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = LocalizeQuery(scene.problem, {});
    ASSERT_EQ(result.status, QueryStatus::SCALE_UNOBSERVABLE) << result.reason;
    if (result.reason.find("one plane") != std::string::npos) {
      ++num_ambiguous;
      EXPECT_FALSE(result.partial_pose);
    } else {
      EXPECT_LE(AngularDistanceRad(result.partial_pose->cam_from_world_rotation, scene.query_cam_from_world.rotation),
                4 * *result.partial_pose->rotation_stddev_rad);
    }
  }
  EXPECT_GE(num_ambiguous, 7);
}

TEST(EstimateCovariance, SeveralDatabasePositionsBeforeAPlaneSuffice) {
  SyntheticSceneOptions options = Noisy(SceneLayout::RING, 5);
  options.has_planar_points = true;
  options.has_geometry = false;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  ASSERT_TRUE(HasPose(result.status)) << result.reason;
  EXPECT_LE(NormalizedSquaredError(result, scene.query_cam_from_world), 22.5);  // 99.9 %
}

TEST(EstimateCovariance, LineOfPlacesWithoutCommonPointsIsNamed) {
  SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::LINE_ON_LINE, 7));
  LeaveOneMatchPerPoint(&scene);
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  ASSERT_EQ(result.status, QueryStatus::DEGENERATE_BASELINE) << result.reason;
  EXPECT_THAT(result.reason, HasSubstr("on one line"));
  ExpectTruePartialPose(result, scene);
}

TEST(EstimateCovariance, PanoramaIsNamed) {
  for (const double noise_px : {0.0, 0.5}) {
    SyntheticSceneOptions options = Noisy(SceneLayout::PURE_ROTATION, 5);
    options.pixel_noise_px = noise_px;
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = LocalizeQuery(scene.problem, {});
    ASSERT_EQ(result.status, QueryStatus::DEGENERATE_BASELINE) << result.reason;
    EXPECT_THAT(result.reason, HasSubstr("no baseline"));
    ASSERT_TRUE(result.partial_pose);
    EXPECT_FALSE(result.partial_pose->bearing);
    EXPECT_LE(AngularDistanceRad(result.partial_pose->cam_from_world_rotation, scene.query_cam_from_world.rotation),
              DegToRad(0.1));
  }
}

TEST(EstimateCovariance, TheWeakestDirectionIsNamed) {
  const SyntheticScene scene = MakeSyntheticScene(Noisy(SceneLayout::LINE, 3));
  LocalizerOptions localizer = WithExactDatabase();
  const LocalizationResult found = LocalizeQuery(scene.problem, localizer);
  ASSERT_EQ(found.status, QueryStatus::LOCALIZED);
  localizer.max_position_stddev_ratio = found.spread.position_stddevs[0] / scene.median_depth / 2;
  const LocalizationResult open = LocalizeQuery(scene.problem, localizer);
  ASSERT_EQ(open.status, QueryStatus::DEGENERATE_BASELINE);
  const Eigen::Vector3d& direction = found.spread.weakest_direction_in_world;
  EXPECT_THAT(open.reason,
              HasSubstr(Format("unobservable along (%.2f, %.2f, %.2f)", direction.x(), direction.y(), direction.z())));
  ExpectTruePartialPose(open, scene);
}

// Expects 1 as the mean of the squared errors along the weakest direction over the variance there. The standard
// deviation of the mean of 60 queries is 0.18.
TEST(EstimateCovariance, PositionStddevsAreThoseOfTheErrors) {
  SyntheticSceneOptions options = Noisy(SceneLayout::RING, 4);
  options.origin = {500000, 5400000, 300};
  LocalizerOptions localizer;
  localizer.focal_length_stddev_ratio = 0;  // the scene's are exact
  double sum = 0;
  for (options.seed = 0; options.seed < 60; ++options.seed) {
    const SyntheticScene scene = MakeSyntheticScene(options);
    const LocalizationResult result = LocalizeQuery(scene.problem, WithExactDatabase());
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED);
    const Eigen::Vector3d error = CamInWorld(result.cam_from_world) - CamInWorld(scene.query_cam_from_world);
    const double normalized = error.dot(result.spread.weakest_direction_in_world) / result.spread.position_stddevs[0];
    sum += normalized * normalized;
    EXPECT_GE(result.spread.position_stddevs[0], result.spread.position_stddevs[1]);
    EXPECT_GE(result.spread.position_stddevs[1], result.spread.position_stddevs[2]);
  }
  EXPECT_GT(sum / 60, 0.5);
  EXPECT_LT(sum / 60, 1.6);
}

// Two single queries at their true poses, and an adjustment with the covariances that a test sets.
struct UncertaintyInput {
  StageInput stages;
  Refined refined;
  PairRefs pairs;

  std::vector<PoseDistribution> Estimate(const LocalizerOptions& options = {}) const {
    Refined complete = refined;
    complete.variance_factor = VarianceFactor();
    complete.SetMissingVariances();
    return EstimateUncertainties(stages.layout, pairs, complete, options);
  }
  double VarianceFactor() const {
    return lazyloc::VarianceFactor(refined.adjustment.posed, refined.adjustment.tracks,
                                   RobustLoss(LocalizerOptions().bundle_adjustment.loss_scale_sigma));
  }
  void SetCovariance(int query, const Eigen::Matrix<double, 6, 6>& covariance) {
    refined.adjustment.frame_covariances[query] = refined.adjustment.image_covariances[query] = covariance;
  }
};

constexpr int kNumPoints = 40;

std::unique_ptr<UncertaintyInput> MakeUncertaintyInput(int num_database_images = 6) {
  SyntheticGroupOptions options;
  options.num_frames = 2;
  options.num_sensors = 1;
  options.num_points = kNumPoints;
  options.num_database_images = num_database_images;
  options.pixel_noise_px = 1;
  options.has_query_pairs = false;
  auto input = std::make_unique<UncertaintyInput>();  // `pairs` are pointers into it
  input->stages = MakeStageInput(MakeSyntheticGroup(options));
  input->pairs = Refs(input->stages.pairs);
  BundleAdjustmentResult& adjustment = input->refined.adjustment;
  adjustment.posed = input->stages.truth;
  for (Image& image : adjustment.posed.images) image.noise_px = 1;
  adjustment.tracks = input->stages.tracks;
  const Eigen::Matrix<double, 6, 6> unknown = Eigen::Matrix<double, 6, 6>::Zero();
  adjustment.frame_covariances.assign(adjustment.posed.frames.size(), unknown);
  adjustment.image_covariances.assign(adjustment.posed.images.size(), unknown);
  adjustment.image_shared_errors.assign(adjustment.posed.images.size(), unknown);
  adjustment.intrinsics_scores.resize(adjustment.posed.frames.size());
  for (const int query : {0, 1}) input->SetCovariance(query, 1e-6 * Eigen::Matrix<double, 6, 6>::Identity());
  return input;
}

// Returns the covariance of a pose with a large standard deviation of the position in one direction of the world.
Eigen::Matrix<double, 6, 6> WeakAlong(const Eigen::Vector3d& direction, double stddev, const Rigid3d& pose) {
  const Eigen::Vector3d in_cam = stddev * (pose.rotation * direction.normalized());
  Eigen::Matrix<double, 6, 6> covariance = 1e-10 * Eigen::Matrix<double, 6, 6>::Identity();
  covariance.bottomRightCorner<3, 3>() += in_cam * in_cam.transpose();
  return covariance;
}

TEST(EstimateUncertainties, CovarianceIsThatOfTheAdjustmentTimesTheVarianceFactor) {
  const auto input = MakeUncertaintyInput();
  const std::vector<PoseDistribution> poses = input->Estimate();
  ASSERT_EQ(poses.size(), 2u);
  for (int query = 0; query < 2; ++query) {
    const Rigid3d truth = CamFromWorld(input->stages.truth, query);
    const Eigen::Matrix<double, 6, 6> covariance =
        input->VarianceFactor() * input->refined.adjustment.image_covariances[query];
    const Eigen::Matrix<double, 6, 6> found = poses[query].CovarianceAt(truth.translation);
    EXPECT_LE((found - covariance).norm(), 1e-6 * covariance.norm());
    EXPECT_NEAR(poses[query].Spread().rotation_stddev_rad, 1e-3 * std::sqrt(input->VarianceFactor()), 1e-9);
  }
}

TEST(EstimateUncertainties, FewDatabaseImagesEnlargeTheCovariance) {
  const auto input = MakeUncertaintyInput();
  BundleAdjustmentResult& adjustment = input->refined.adjustment;
  adjustment.image_shared_errors[1] = 1e-5 * Eigen::Matrix<double, 6, 6>::Identity();
  adjustment.intrinsics_scores[1].small_sample_factor = 3;
  const std::vector<PoseDistribution> poses = input->Estimate();
  EXPECT_NEAR(poses[0].of_images(0, 0), 1e-6 * input->VarianceFactor(), 1e-12);
  EXPECT_NEAR(poses[1].of_images(0, 0), 3 * 1e-6 * input->VarianceFactor() + 1e-5, 1e-12);
}

// Checks that the part of a prior is counted with the variance that the adjustment shows, not with that which it took
// for granted.
TEST(EstimateUncertainties, PriorsCountAsTheAdjustmentShowsThem) {
  const auto input = MakeUncertaintyInput();
  input->stages.layout.origin.setZero();
  BundleAdjustmentResult& adjustment = input->refined.adjustment;
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(10, 10);
  adjustment.posed.prior_groups = {{{2, 3, 4, 5, 6, 7, 8, 9, 10, 11}, {{identity, 1}}}};
  const Eigen::Matrix<double, 6, 6> part = 1e-4 * Eigen::Matrix<double, 6, 6>::Identity();
  const double image_factor = input->VarianceFactor();
  const Eigen::MatrixXd information = 1e6 * Eigen::MatrixXd::Identity(60, 60);
  for (const double deviation : {0.2, 3.0}) {
    adjustment.prior_fits = {{Eigen::MatrixXd::Constant(10, 6, deviation), information, {{part, 0 * part}}}};
    const double shown = deviation * deviation;  // nearly: the expectation counts as one of 61 deviations
    const std::vector<PoseDistribution> poses = input->Estimate();
    EXPECT_NEAR(poses[0].of_images(0, 0), 1e-6 * image_factor + 1e-4 * (shown - image_factor), 5e-6 * shown);
    EXPECT_NEAR(poses[1].of_images(0, 0), 1e-6 * image_factor, 1e-12);
  }
}

TEST(EstimateUncertainties, WeakestDirectionIsFound) {
  const auto input = MakeUncertaintyInput();
  const Eigen::Vector3d direction(1, 2, -2);
  input->SetCovariance(0, WeakAlong(direction, 0.1, CamFromWorld(input->stages.truth, 0)));
  const PoseSpread spread = input->Estimate()[0].Spread();
  EXPECT_NEAR(spread.position_stddevs[0], 0.1 * std::sqrt(input->VarianceFactor()), 1e-3);
  EXPECT_NEAR(std::abs(spread.weakest_direction_in_world.dot(direction.normalized())), 1, 1e-6);
}

TEST(EstimateUncertainties, FramesWithTooFewTracksAreNamed) {
  const auto input = MakeUncertaintyInput();
  input->refined.adjustment.tracks.resize(kNumPoints + 5);
  const Failure failure = FailureOf([&] { input->Estimate(); });
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_THAT(failure.frames, testing::ElementsAre(1));
  EXPECT_THAT(failure.reason, HasSubstr("only 5 tracks"));
}

TEST(EstimateUncertainties, FramesWithUnobservablePositionsAreNamed) {
  const auto input = MakeUncertaintyInput();
  const Rigid3d truth = CamFromWorld(input->stages.truth, 1);
  input->SetCovariance(1, WeakAlong({0, 1, 0}, 2, truth));
  const Failure failure = FailureOf([&] { input->Estimate(); });
  EXPECT_EQ(failure.cause, QueryStatus::DEGENERATE_BASELINE);
  EXPECT_THAT(failure.frames, testing::ElementsAre(1));
  EXPECT_THAT(failure.reason, HasSubstr("unobservable along"));
  ASSERT_EQ(failure.partial_poses.count(1), 1u);
  EXPECT_EQ(failure.partial_poses.size(), 1u);
  EXPECT_EQ(failure.partial_poses.at(1).cam_from_world_rotation.coeffs(), truth.rotation.coeffs());
  LocalizerOptions options;
  options.max_position_stddev_ratio = 1;
  EXPECT_EQ(input->Estimate(options).size(), 2u);
}

TEST(EstimateUncertainties, LimitOfThePositionIsNotThatOfTheRotation) {
  const auto input = MakeUncertaintyInput();
  Eigen::Matrix<double, 6, 6> covariance = 1e-10 * Eigen::Matrix<double, 6, 6>::Identity();
  covariance.topLeftCorner<3, 3>().diagonal().setConstant(0.3 * 0.3);
  input->SetCovariance(1, covariance);
  LocalizerOptions options;
  options.max_position_stddev_ratio = 1e9;
  EXPECT_THAT(FailureOf([&] { input->Estimate(options); }).frames, testing::ElementsAre(1));
}

TEST(EstimateUncertainties, BearingIsThatOfTheBestDatabaseImage) {
  const auto input = MakeUncertaintyInput();
  const Rigid3d truth = CamFromWorld(input->stages.truth, 0);
  const int best = input->stages.layout.image_of_pair[0][3];
  const Eigen::Vector3d offset = CamInWorld(truth) - CamInWorld(CamFromWorld(input->stages.truth, best));
  input->SetCovariance(0, WeakAlong(offset, 2, truth));
  const Failure failure = FailureOf([&] { input->Estimate(); });
  ASSERT_EQ(failure.partial_poses.count(0), 1u);
  ASSERT_TRUE(failure.partial_poses.at(0).bearing);
  const Bearing& bearing = *failure.partial_poses.at(0).bearing;
  EXPECT_EQ(bearing.database_name, "database103");
  EXPECT_LE(AngleBetweenRad(bearing.dir_database_to_query_in_world, offset), 1e-9);
  EXPECT_LE(bearing.stddev_rad, 1e-3);
}

TEST(EstimateUncertainties, OneDatabaseImageLeavesTheScaleUnobservable) {
  const auto input = MakeUncertaintyInput(/*num_database_images=*/1);
  const Rigid3d truth = CamFromWorld(input->stages.truth, 0);
  input->SetCovariance(0, WeakAlong({0, 1, 0}, 2, truth));
  const Failure failure = FailureOf([&] { input->Estimate(); });
  EXPECT_EQ(failure.cause, QueryStatus::SCALE_UNOBSERVABLE);
  EXPECT_THAT(failure.reason, HasSubstr("one database position"));
}

// One place has one extent only, so a sanitizer must see no access to a second one.
TEST(EstimateUncertainties, OnePlaceCountsAsALine) {
  const auto input = MakeUncertaintyInput();
  input->pairs.clear();
  for (Track& track : input->refined.adjustment.tracks) track.observations.resize(2);
  EXPECT_THAT(FailureOf([&] { input->Estimate(); }).reason, HasSubstr("on one line"));
}

}  // namespace
}  // namespace lazyloc

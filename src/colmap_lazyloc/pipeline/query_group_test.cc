#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_group.h"
#include "colmap_lazyloc/testing/synthetic_video.h"

namespace lazyloc {
namespace {

std::vector<LocalizationResult> Localize(const SyntheticGroup& scene, const LocalizerOptions& options = {}) {
  return LocalizeGroup(scene.group, options);
}

void ExpectNearTruth(const SyntheticGroup& scene, double max_distance, double max_angle_deg,
                     const LocalizerOptions& options = {}) {
  const std::vector<LocalizationResult> results = Localize(scene, options);
  ASSERT_EQ(results.size(), scene.cam_from_world.size());
  for (size_t i = 0; i < results.size(); ++i) {
    EXPECT_EQ(results[i].query_name, scene.group.images[i].problem.query_name);
    ASSERT_EQ(results[i].status, QueryStatus::LOCALIZED) << results[i].query_name << ": " << results[i].reason;
    EXPECT_LE(PositionError(results[i].cam_from_world, scene.cam_from_world[i]), max_distance);
    EXPECT_LE(RotationErrorDeg(results[i].cam_from_world, scene.cam_from_world[i]), max_angle_deg);
  }
}

double SquaredErrorSum(const SyntheticGroup& scene, const std::vector<LocalizationResult>& results) {
  double sum = 0;
  for (size_t i = 0; i < results.size(); ++i) {
    sum += std::pow(PositionError(results[i].cam_from_world, scene.cam_from_world[i]), 2);
  }
  return sum;
}

std::vector<LocalizationResult> LocalizeEachAlone(const SyntheticGroup& scene) {
  std::vector<LocalizationResult> results;
  for (const QueryImage& image : scene.group.images) {
    results.push_back(LocalizeQuery(image.problem, LocalizerOptions()));
  }
  return results;
}

TEST(QueryGroup, NoiseFreeRigsAreExact) {
  SyntheticGroupOptions options;
  for (options.num_sensors = 2; options.num_sensors <= 8; options.num_sensors += 3) {
    for (options.num_frames = 1; options.num_frames <= 2; ++options.num_frames) {
      ExpectNearTruth(MakeSyntheticGroup(options), 1e-7, 1e-6);
    }
  }
}

TEST(QueryGroup, NoiseFreeJointQueriesAreExact) {
  SyntheticGroupOptions options;
  options.num_sensors = 1;
  options.num_frames = 5;
  ExpectNearTruth(MakeSyntheticGroup(options), 1e-7, 1e-6);
}

// Expects errors of about 2e-3, with 150 points of 1 px at f = 800 px, 8 units away; the bound is five times that.
TEST(QueryGroup, RigsWithNoiseAndOutliers) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  options.outlier_pair_ratio = 0.25;
  options.outlier_match_ratio = 0.1;
  for (options.seed = 0; options.seed < 7; ++options.seed) {
    options.num_sensors = 2 + static_cast<int>(options.seed);
    options.num_sensors_without_pairs = options.num_sensors / 3;
    ExpectNearTruth(MakeSyntheticGroup(options), 1.2e-2, 0.1);
  }
}

TEST(QueryGroup, RigHelpsAndJointDoesNotHarm) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  options.num_points = 40;
  options.num_database_images = 4;
  double single_sum = 0, rig_sum = 0, joint_single_sum = 0, joint_sum = 0;
  for (options.seed = 0; options.seed < 10; ++options.seed) {
    options.num_frames = 1;
    options.num_sensors = 4;
    const SyntheticGroup rig = MakeSyntheticGroup(options);
    single_sum += SquaredErrorSum(rig, LocalizeEachAlone(rig));
    rig_sum += SquaredErrorSum(rig, Localize(rig));
    options.num_frames = 4;
    options.num_sensors = 1;
    const SyntheticGroup joint = MakeSyntheticGroup(options);
    joint_single_sum += SquaredErrorSum(joint, LocalizeEachAlone(joint));
    joint_sum += SquaredErrorSum(joint, Localize(joint));
  }
  EXPECT_LT(rig_sum, 0.7 * single_sum);
  EXPECT_LT(joint_sum, 1.05 * joint_single_sum);
}

TEST(QueryGroup, RigResolvesTheScaleOfOneDatabaseImage) {
  SyntheticGroupOptions options;
  options.num_database_images = 1;
  const SyntheticGroup scene = MakeSyntheticGroup(options);
  for (const LocalizationResult& alone : LocalizeEachAlone(scene)) {
    EXPECT_EQ(alone.status, QueryStatus::SCALE_UNOBSERVABLE);
  }
  ExpectNearTruth(scene, 1e-6, 1e-5);
  options.pixel_noise_px = 0.5;
  ExpectNearTruth(MakeSyntheticGroup(options), 0.2, 0.5);
}

// Uses a rig like the faces of a panorama.
TEST(QueryGroup, CamerasAtOnePointAreAnExactRig) {
  SyntheticGroupOptions options;
  options.has_common_centre = true;
  options.num_sensors = 4;
  ExpectNearTruth(MakeSyntheticGroup(options), 1e-7, 1e-6);
  options.pixel_noise_px = 1;
  for (const bool has_database_rigs : {false, true}) {
    options.has_database_rigs = has_database_rigs;
    const SyntheticGroup scene = MakeSyntheticGroup(options);
    LocalizerOptions exact;
    exact.rig_noise_px = 0;
    const auto recognized = Localize(scene), stated = Localize(scene, exact);
    for (size_t i = 0; i < recognized.size(); ++i) {
      ASSERT_EQ(recognized[i].status, QueryStatus::LOCALIZED) << recognized[i].reason;
      EXPECT_EQ(recognized[i].cam_from_world.translation, stated[i].cam_from_world.translation);
      EXPECT_EQ(recognized[i].covariance, stated[i].covariance);
    }
  }
}

TEST(QueryGroup, CamerasAtOnePointDoNotResolveTheScaleOfOneDatabasePlace) {
  SyntheticGroupOptions options;
  options.has_common_centre = true;
  for (const bool has_database_rigs : {false, true}) {
    options.has_database_rigs = has_database_rigs;
    options.num_database_images = has_database_rigs ? 2 : 1;  // one place
    for (const double noise_px : {0.0, 0.5}) {
      options.pixel_noise_px = noise_px;
      for (const LocalizationResult& result : Localize(MakeSyntheticGroup(options))) {
        EXPECT_EQ(result.status, QueryStatus::SCALE_UNOBSERVABLE) << result.reason;
      }
    }
  }
}

TEST(QueryGroup, OthersResolveTheScaleOfAQueryWithOneDatabaseImage) {
  SyntheticGroupOptions options;
  options.num_frames = 4;
  options.num_sensors = 1;
  for (options.pixel_noise_px = 0; options.pixel_noise_px < 2; ++options.pixel_noise_px) {
    SyntheticGroup scene = MakeSyntheticGroup(options);
    scene.group.images[3].problem.pairs.resize(1);
    EXPECT_EQ(LocalizeEachAlone(scene)[3].status, QueryStatus::SCALE_UNOBSERVABLE);
    ExpectNearTruth(scene, options.pixel_noise_px == 0 ? 1e-6 : 2e-2, 0.2);
  }
}

TEST(QueryGroup, LastImageOfAGroupIsALoneOne) {
  SyntheticGroupOptions options;
  options.num_frames = 2;
  options.num_sensors = 1;
  options.has_query_pairs = false;
  options.pixel_noise_px = 0.5;
  SyntheticGroup scene = MakeSyntheticGroup(options);
  scene.group.images[1].problem.pairs.clear();
  LocalizationProblem& problem = scene.group.images[0].problem;
  problem.query_camera = WithFocalFactor(problem.query_camera, 1.05);
  problem.intrinsics_origin = IntrinsicsOrigin::EXIF;
  for (ImagePair& pair : problem.pairs) pair.geometry->config = TwoViewConfig::UNCALIBRATED;
  const std::vector<LocalizationResult> results = Localize(scene);
  EXPECT_EQ(results[0].status, QueryStatus::LOCALIZED) << results[0].reason;
  EXPECT_EQ(results[0].intrinsics.verdict, IntrinsicsVerdict::REFINED);
  EXPECT_EQ(results[1].status, QueryStatus::NO_PAIRS);
}

TEST(QueryGroup, CovarianceOfEachImageMatchesTheErrorsSpread) {
  // Expects 6 as the mean of the squared errors normalised by their covariances; see the test of single queries.
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  double sum = 0;
  const int num_trials = 40;
  for (options.seed = 0; options.seed < num_trials; ++options.seed) {
    const SyntheticGroup scene = MakeSyntheticGroup(options);
    const LocalizationResult result = Localize(scene, WithExactDatabase()).back();
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED);
    const Rigid3d& truth = scene.cam_from_world.back();
    Eigen::Matrix<double, 6, 1> error;
    const Eigen::AngleAxisd rotation_error(truth.rotation * result.cam_from_world.rotation.conjugate());
    error << rotation_error.angle() * rotation_error.axis(), truth.translation - result.cam_from_world.translation;
    sum += error.dot(result.covariance.ldlt().solve(error));
  }
  EXPECT_GT(sum / num_trials, 4);
  EXPECT_LT(sum / num_trials, 9);
}

TEST(QueryGroup, BadMemberIsDroppedWithAStatus) {
  SyntheticGroupOptions options;
  options.num_sensors = 1;
  options.num_frames = 4;
  options.pixel_noise_px = 1;
  SyntheticGroup scene = MakeSyntheticGroup(options);
  scene.group.images[1].problem.query_keypoints.clear();
  scene.group.images[1].problem.pairs.clear();
  Random random(3);
  for (ImagePair& pair : scene.group.images[2].problem.pairs) {
    pair.geometry->query_from_other = Rigid3d{RandomRotation(&random), RandomVector(&random).normalized()};
    Matches& matches = pair.geometry->inlier_matches;
    for (Match& match : matches) match.other_point = static_cast<uint32_t>(random() % matches.size());
  }
  auto& query_pairs = scene.group.query_pairs;
  const auto is_of_bad_member = [](const QueryPair& pair) {
    return pair.query < 3 || pair.other == 1 || pair.other == 2;
  };
  query_pairs.erase(std::remove_if(query_pairs.begin(), query_pairs.end(), is_of_bad_member), query_pairs.end());
  const std::vector<LocalizationResult> results = Localize(scene);
  EXPECT_EQ(results[1].status, QueryStatus::NO_FEATURES);
  EXPECT_EQ(results[2].status, QueryStatus::INCONSISTENT_ROTATIONS) << results[2].reason;
  for (const int good : {0, 3}) {
    ASSERT_EQ(results[good].status, QueryStatus::LOCALIZED) << results[good].reason;
    EXPECT_LE(PositionError(results[good].cam_from_world, scene.cam_from_world[good]), 1e-2);
  }
}

// Returns the squared errors of a trajectory with its scale, and adds those without. Checks the latter.
double CompareTrajectories(const SyntheticGroupOptions& options, double* error_without_scale) {
  SyntheticGroup scene = MakeSyntheticGroup(options);
  const double error = SquaredErrorSum(scene, Localize(scene, WithExactDatabase()));
  for (QueryImage& image : scene.group.images) image.cam_from_rig.translation /= 3;
  scene.group.has_rig_scale = false;
  ExpectNearTruth(scene, options.pixel_noise_px == 0 ? 1e-6 : 1e-2, 0.1);
  const std::vector<LocalizationResult> results = Localize(scene, WithExactDatabase());
  for (const LocalizationResult& result : results) {
    EXPECT_NEAR(result.rig_scale, 3, options.pixel_noise_px == 0 ? 1e-5 : 0.05);
  }
  *error_without_scale += SquaredErrorSum(scene, results);
  return error;
}

TEST(QueryGroup, ScaleOfATrajectoryIsFound) {
  SyntheticGroupOptions options;
  options.num_sensors = 5;
  double error_without_scale = 0;
  double error = CompareTrajectories(options, &error_without_scale);
  EXPECT_LT(error, error_without_scale + 1e-12);
  options.pixel_noise_px = 1;
  for (options.seed = 1; options.seed <= 6; ++options.seed) error += CompareTrajectories(options, &error_without_scale);
  EXPECT_LT(error, error_without_scale) << "a known scale helps";
}

// One more parameter of five images costs little. Relative poses that count as exact would cost a factor of five.
TEST(QueryGroup, TrajectoryOfUnknownScaleAllowsForErrorsOfItsPoses) {
  SyntheticGroupOptions options;
  options.num_sensors = 5;
  options.pixel_noise_px = 0.5;
  options.has_query_pairs = false;
  double known = 0, unknown = 0;
  for (options.seed = 0; options.seed < 10; ++options.seed) {
    SyntheticGroup scene = MakeSyntheticGroup(options);
    Random random(options.seed);
    for (QueryImage& image : scene.group.images) image.cam_from_rig.translation += 0.01 * RandomVector(&random);
    known += SquaredErrorSum(scene, Localize(scene, WithExactDatabase()));
    scene.group.has_rig_scale = false;
    unknown += SquaredErrorSum(scene, Localize(scene, WithExactDatabase()));
  }
  EXPECT_LE(unknown, 1.5 * known) << unknown / known;
}

TEST(QueryGroup, TrajectoryOfUnobservableScaleIsLocalizedImageByImage) {
  SyntheticGroupOptions options;
  options.num_database_images = 1;
  SyntheticGroup scene = MakeSyntheticGroup(options);
  scene.group.has_rig_scale = false;
  for (const LocalizationResult& result : Localize(scene)) EXPECT_EQ(result.status, QueryStatus::SCALE_UNOBSERVABLE);
}

TEST(QueryGroup, NoiseFreeIsExactWithDatabaseRigs) {
  SyntheticGroupOptions options;
  options.has_database_rigs = true;
  for (options.num_sensors = 2; options.num_sensors <= 3; ++options.num_sensors) {
    for (options.num_frames = 1; options.num_frames <= 2; ++options.num_frames) {
      ExpectNearTruth(MakeSyntheticGroup(options), 1e-7, 1e-6);
    }
  }
}

// Returns the squared position errors of the first query, summed over 20 scenes: localized as a rig, and alone.
std::pair<double, double> ErrorsOfRigAndSingleImage(SyntheticGroupOptions options, const LocalizerOptions& localizer) {
  double rig = 0, alone = 0;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticGroup scene = MakeSyntheticGroup(options);
    const std::vector<LocalizationResult> together = Localize(scene, localizer);
    const LocalizationResult single = LocalizeQuery(scene.group.images[0].problem, localizer);
    EXPECT_EQ(together[0].status, QueryStatus::LOCALIZED) << together[0].reason;
    EXPECT_EQ(single.status, QueryStatus::LOCALIZED) << single.reason;
    rig += std::pow(PositionError(together[0].cam_from_world, scene.cam_from_world[0]), 2);
    alone += std::pow(PositionError(single.cam_from_world, scene.cam_from_world[0]), 2);
  }
  return {rig, alone};
}

// Two images have half the squared error of one. Allows for the chance of 20 scenes of 3 coordinates each: the ratio of
// two sums has a relative deviation of about sqrt(2 / 60 + 2 / 60) = 0.26, less because the scenes are the same.
TEST(QueryGroup, RigNeverLosesToItsSingleImages) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 0.5;
  options.has_query_pairs = false;
  for (const bool has_database_rigs : {true, false}) {
    options.has_database_rigs = has_database_rigs;
    for (const double calibration_error_deg : {0.0, 0.02, 0.05}) {
      options.calibration_error_deg = calibration_error_deg;
      const auto [rig, alone] = ErrorsOfRigAndSingleImage(options, {});
      // A calibration that only the query has gains nothing while it may be as wrong as the database.
      EXPECT_LE(rig, (has_database_rigs ? 0.85 : 1.25) * alone)
          << has_database_rigs << ", " << calibration_error_deg << " deg: " << rig / alone;
    }
  }
}

TEST(QueryGroup, CovarianceOfARigIncludesItsCalibration) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 0.5;
  const SyntheticGroup scene = MakeSyntheticGroup(options);
  LocalizerOptions exact, uncertain;
  exact.rig_noise_px = 0;
  uncertain.rig_noise_px = 1;
  const auto known = Localize(scene, exact), unknown = Localize(scene, uncertain);
  for (const size_t query : {0, 1}) {
    EXPECT_GT(unknown[query].covariance.trace(), 1.2 * known[query].covariance.trace()) << query;
  }
}

TEST(QueryGroup, LoneImagesOfUnknownFocalLengthAndThePapersMethodAreLocalizedIndividually) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  options.num_frames = 3;
  options.num_sensors = 1;
  const SyntheticGroup scene = MakeSyntheticGroup(options);
  LocalizerOptions refine, paper;
  refine.intrinsics = IntrinsicsMode::REFINE;
  paper.method = Method::PAPER;
  for (const LocalizerOptions& localizer : {refine, paper}) {
    const std::vector<LocalizationResult> results = LocalizeGroup(scene.group, localizer);
    for (size_t i = 0; i < results.size(); ++i) {
      const LocalizationResult alone = LocalizeQuery(scene.group.images[i].problem, localizer);
      ASSERT_EQ(results[i].status, QueryStatus::LOCALIZED) << results[i].reason;
      EXPECT_EQ(results[i].cam_from_world.translation, alone.cam_from_world.translation);
      EXPECT_EQ(results[i].is_camera_refined, localizer.intrinsics == IntrinsicsMode::REFINE);
    }
  }
}

// Uses 60 queries with database images of their own, because their reduced camera system is sparse.
TEST(QueryGroup, LongVideoIsExact) {
  SyntheticVideoOptions options;
  options.num_queries = 60;
  options.pixel_noise_px = 0;
  ExpectNearTruth(MakeSyntheticVideo(options), 1e-6, 1e-5);
}

class CalibrationErrors : public testing::TestWithParam<double> {};

TEST_P(CalibrationErrors, AreDetected) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  options.calibration_error_deg = GetParam();
  for (options.num_sensors = 2; options.num_sensors <= 3; ++options.num_sensors) {
    for (const LocalizationResult& result : Localize(MakeSyntheticGroup(options))) {
      EXPECT_EQ(result.status, QueryStatus::INCONSISTENT_RIG);
      EXPECT_THAT(result.reason, testing::HasSubstr("calibration"));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(QueryGroup, CalibrationErrors, testing::Values(3, 20));

}  // namespace
}  // namespace lazyloc

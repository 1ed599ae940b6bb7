#include "colmap_lazyloc/refinement/covariance.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/scene/refs.h"
#include "colmap_lazyloc/testing/sampled_covariance.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
constexpr double kWideScale = 1e6;  // makes the loss that of plain least squares

BundleAdjustmentOptions LeastSquares() {
  BundleAdjustmentOptions options;
  options.loss_scale_sigma = kWideScale;
  return options;
}

TEST(PoseCovariance, PredictsTheSpreadOfAdjustedPoses) {
  // Allows four times the relative error of a sample variance of 300 trials, sqrt(2 / 300) = 8 %.
  const SyntheticTracksOptions options;
  const SyntheticTracks truth = MakeSyntheticTracks(options);
  const Matrix6d predicted = AdjustBundle(truth.posed, truth.tracks, LeastSquares()).image_covariances[0];
  const Matrix6d sampled = SampleCovariances(truth, options.focal_length_px, LeastSquares(), 300)[0];
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(sampled(i, i) / predicted(i, i), 1, 0.33) << i;
}

// Makes points of which each is seen by the query and two of twelve database images. The first names the pair.
SyntheticTracks MakePairs(double noise_px) {
  SyntheticTracksOptions options;
  options.num_database = 12;
  options.num_points = 360;
  options.noise_px = noise_px;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  for (size_t i = 0; i < scene.tracks.size(); ++i) {
    std::vector<TrackObservation>& observations = scene.tracks[i].observations;
    const size_t first = 1 + i % 11;
    observations = {observations[0], observations[first], observations[first + 1]};
  }
  return scene;
}

TEST(SharedErrors, AddTheSpreadThatShiftedPairsCause) {
  // Moves the query's keypoints of the tracks of each database image together, as repeated structure does.
  const double noise_px = 0.3, shift_px = 2;
  const int num_trials = 100;
  const SyntheticTracks truth = MakePairs(noise_px);
  const std::vector<Rigid3d> exact = CamsFromWorld(truth.posed);
  Random random(5);
  Matrix6d sampled = Matrix6d::Zero(), independent = sampled, shared = sampled;
  for (int trial = 0; trial < num_trials; ++trial) {
    std::vector<Eigen::Vector2d> shifts;
    for (size_t image = 0; image < exact.size(); ++image) {
      shifts.emplace_back(shift_px * RandomVector(&random).head<2>());
    }
    std::vector<Track> tracks = truth.tracks;
    for (Track& track : tracks) {
      for (TrackObservation& element : track.observations) {
        Eigen::Vector2d offset = noise_px * RandomVector(&random).head<2>();
        if (element.image == 0) offset += shifts[track.observations[1].image];
        element.observation =
            ObserveAt(exact[element.image] * track.point_in_world, SyntheticTracksOptions().focal_length_px, offset);
      }
    }
    const BundleAdjustmentResult result = AdjustBundle(truth.posed, tracks, LeastSquares());
    const Rigid3d pose = CamFromWorld(result.posed, 0);
    Eigen::Matrix<double, 6, 1> error;
    error << LogSO3(pose.rotation * exact[0].rotation.conjugate()), pose.translation - exact[0].translation;
    sampled += error * error.transpose() / num_trials;
    independent +=
        VarianceFactor(result.posed, result.tracks, RobustLoss(kWideScale)) * result.image_covariances[0] / num_trials;
    shared += result.image_shared_errors[0] / num_trials;
  }
  // A sample variance of 100 trials is off by 14 %, and eleven clusters give a rough estimate of each.
  for (int i = 0; i < 6; ++i) {
    EXPECT_GT(sampled(i, i), 1.5 * independent(i, i)) << i;
    EXPECT_NEAR(std::log((independent + shared)(i, i) / sampled(i, i)), 0, std::log(1.6)) << i;
  }
}

TEST(SharedErrors, AreSmallForIndependentNoise) {
  const SyntheticTracks scene = MakePairs(1);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, LeastSquares());
  const Matrix6d sum = result.image_covariances[0] + result.image_shared_errors[0];
  for (int i = 0; i < 6; ++i) EXPECT_LE(sum(i, i), 3 * result.image_covariances[0](i, i)) << i;
}

TEST(SharedErrors, FewImagesAreASmallSampleOfErrorsOfUnknownSize) {
  SyntheticTracks scene = MakePairs(1);
  scene.posed.frames[1].prior = MakePosePrior(scene.posed.frames[1].frame_from_world, 1, {500, 10});
  const auto factor = [&scene](int num_components, double exact_probability) {
    scene.posed.prior_groups = {{{1}, {}, exact_probability}};
    scene.posed.prior_groups[0].components.resize(num_components, {Eigen::MatrixXd::Identity(1, 1), 1e-3});
    return AdjustBundle(scene.posed, scene.tracks, LeastSquares()).intrinsics_scores[0].small_sample_factor;
  };
  EXPECT_EQ(factor(1, 0), 1);  // of a known size
  EXPECT_DOUBLE_EQ(factor(3, 0), 11.0 / 8);
  EXPECT_DOUBLE_EQ(factor(3, 0.75), 1 + 0.25 * 3 / 8);
  EXPECT_DOUBLE_EQ(factor(3, 1), 1);
}

TEST(PoseCovariance, OneDatabaseImageLeavesTheDistanceUnobservable) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, LeastSquares());
  const Rigid3d pose = CamFromWorld(result.posed, 0);
  const PoseSpread spread = MakePoseDistribution(pose, result.image_covariances[0]).Spread();
  EXPECT_GE(spread.position_stddevs[0], 100);
  EXPECT_LE(spread.position_stddevs[1], 0.1);
  const Eigen::Vector3d baseline = CamInWorld(pose) - CamInWorld(CamFromWorld(scene.posed, 1));
  EXPECT_LE(baseline.normalized().cross(spread.weakest_direction_in_world).norm(), 1e-3);
}

TEST(ImageCovariance, IsThatOfSampledFrames) {
  // Samples the frame's pose and scale from their covariance, which gives each variance to sqrt(2 / 20000) = 1 %.
  Random random(2);
  const Rigid3d frame_from_world = LookAt({1, 2, -8}, {0, 0, 0});
  Image image;
  image.cam_from_frame = {RandomRotation(&random), RandomVector(&random)};
  for (const int num_parameters : {6, 7}) {
    const Eigen::MatrixXd root =
        Eigen::MatrixXd::NullaryExpr(num_parameters, num_parameters, [&] { return 1e-3 * RandomVector(&random).x(); });
    const Matrix6d predicted = ImageCovariance(image, num_parameters == 7, root * root.transpose());
    const Rigid3d exact = CamFromWorld(image, frame_from_world);
    Matrix6d sampled = Matrix6d::Zero();
    const int num_trials = 20000;
    for (int trial = 0; trial < num_trials; ++trial) {
      const Eigen::VectorXd move =
          root * Eigen::VectorXd::NullaryExpr(num_parameters, [&] { return RandomVector(&random).x(); });
      Image scaled = image;
      if (num_parameters == 7) scaled.cam_from_frame.translation *= std::exp(move[6]);
      const Rigid3d moved = CamFromWorld(scaled, {ExpSO3(move.head<3>()) * frame_from_world.rotation,
                                                  frame_from_world.translation + move.segment<3>(3)});
      Eigen::Matrix<double, 6, 1> error;
      error << LogSO3(moved.rotation * exact.rotation.conjugate()), moved.translation - exact.translation;
      sampled += error * error.transpose() / num_trials;
    }
    EXPECT_LE((sampled - predicted).norm(), 0.05 * predicted.norm()) << num_parameters << " parameters";
  }
}

TEST(MedianDistance, IsFromTheProjectionCentre) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d pose = CamFromWorld(scene.posed, 2);
  for (Track& track : scene.tracks) track.point_in_world = CamInWorld(pose) + Eigen::Vector3d(0, 3, 4);
  EXPECT_NEAR(MedianDistance(pose, Refs(scene.tracks)), 5, 1e-12);
}

TEST(VarianceFactor, FindsTheNoise) {
  SyntheticTracksOptions options;
  options.num_points = 500;
  options.noise_px = 2;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  BundleAdjustmentResult adjusted = AdjustBundle(scene.posed, scene.tracks, LeastSquares());
  ASSERT_TRUE(adjusted.summary.success);
  EXPECT_NEAR(VarianceFactor(adjusted.posed, adjusted.tracks, RobustLoss(kWideScale)), 4, 0.3);
  for (Image& image : adjusted.posed.images) image.noise_px = 2;
  EXPECT_NEAR(VarianceFactor(adjusted.posed, adjusted.tracks, RobustLoss(kWideScale)), 1, 0.08);
}

TEST(VarianceFactor, DoesNotDependOnTheLengthOfTracks) {
  // A point takes up as much of the weight as of the degrees of freedom: else the factor of short tracks is too large.
  std::vector<double> factors;
  for (const int num_database : {2, 12}) {
    SyntheticTracksOptions options;
    options.num_points = 1000;
    options.num_database = num_database;
    options.noise_px = 1;
    const SyntheticTracks scene = MakeSyntheticTracks(options);
    BundleAdjustmentOptions robust;
    robust.loss_scale_sigma = 2;
    const BundleAdjustmentResult adjusted = AdjustBundle(scene.posed, scene.tracks, robust);
    ASSERT_TRUE(adjusted.summary.success);
    factors.push_back(VarianceFactor(adjusted.posed, adjusted.tracks, RobustLoss(2)));
  }
  EXPECT_NEAR(factors[0], factors[1], 0.1 * factors[1]);
}

}  // namespace
}  // namespace lazyloc

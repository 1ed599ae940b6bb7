#include "colmap_lazyloc/refinement/intrinsics_score.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500;

Observation PinholeObservation(const Eigen::Vector2d& offset) {
  const Eigen::Vector3d ray = (offset / kFocalLengthPx).homogeneous();
  Eigen::Matrix<double, 2, 3> px_from_cam;
  px_from_cam << kFocalLengthPx, 0, -offset.x(), 0, kFocalLengthPx, -offset.y();
  return {ray.normalized(), px_from_cam * ray.norm(), offset};
}

// Linearises the observations of the first image at the points, as an adjustment of its focal length needs it.
std::vector<Track> ObservedAtPoints(const PosedImages& posed, std::vector<Track> tracks) {
  for (Track& track : tracks) {
    Observation& observation = track.observations.front().observation;
    const Eigen::Vector3d point_in_cam = CamFromWorld(posed, 0) * track.point_in_world;
    const Eigen::Vector2d projection = kFocalLengthPx * point_in_cam.hnormalized();
    const Eigen::Vector2d error = projection - observation.px_from_log_focal;
    observation = PinholeObservation(projection);
    observation.px_from_cam += error * observation.ray_in_cam.transpose();
  }
  return tracks;
}

// Makes queries (frame 0 first) whose keypoints are displaced as by cameras with other intrinsics.
SyntheticTracks MakeTracks(const IntrinsicsScore::Vector& corrections, int num_query, bool has_priors,
                           double noise_px) {
  SyntheticTracksOptions options;
  options.num_query = num_query;
  options.noise_px = noise_px;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  for (Track& track : scene.tracks) {
    for (int query = 0; query < num_query; ++query) {
      Observation& observation = track.observations[query].observation;
      const Eigen::Vector2d offset = kFocalLengthPx * observation.ray_in_cam.hnormalized();
      const Eigen::Vector2d moved =
          offset * (std::exp(corrections[LOG_FOCAL_FACTOR]) +
                    corrections[RADIAL_DISTORTION] * offset.squaredNorm() / std::pow(kRadialUnitPx, 3) +
                    corrections[FIFTH_POWER_DISTORTION] * std::pow(offset.norm(), 4) / std::pow(kRadialUnitPx, 5)) +
          corrections[LOG_ASPECT_RATIO] * Eigen::Vector2d(-0.5, 0.5).cwiseProduct(offset) +
          Eigen::Vector2d(corrections[PRINCIPAL_POINT_X], corrections[PRINCIPAL_POINT_Y]);
      observation = PinholeObservation(moved);
    }
  }
  for (Frame& frame : scene.posed.frames) {
    if (frame.is_database && has_priors) frame.prior = PosePrior{frame.frame_from_world, 1e-3, 5e-3};
  }
  if (!has_priors) return scene;
  PriorGroup group;
  for (size_t i = 0; i < scene.posed.frames.size(); ++i) {
    if (scene.posed.frames[i].prior) group.frames.push_back(static_cast<int>(i));
  }
  const auto size = static_cast<Eigen::Index>(group.frames.size());
  group.components = {{Eigen::MatrixXd::Identity(size, size), 1}};
  scene.posed.prior_groups = {group};
  return scene;
}

IntrinsicsScore::Vector Corrections(double log_focal, double x, double y, double log_aspect, double radial,
                                    double fifth_power = 0) {
  return (IntrinsicsScore::Vector() << log_focal, x, y, log_aspect, radial, fifth_power).finished();
}

class Priors : public testing::TestWithParam<bool> {};

TEST_P(Priors, StepOfTheFocalLengthIsThatOfAnAdjustmentThatEstimatesIt) {
  const SyntheticTracks scene = MakeTracks(Corrections(0.003, 0, 0, 0, 0), 1, GetParam(), 0.3);
  const BundleAdjustmentResult fixed = AdjustBundle(scene.posed, scene.tracks, {});
  PosedImages free = fixed.posed;
  free.images[0].log_focal_factor = 0;
  const BundleAdjustmentResult estimated = AdjustBundle(free, ObservedAtPoints(free, fixed.tracks), {});
  const IntrinsicsScore &score = fixed.intrinsics_scores[0], &reference = estimated.intrinsics_scores[0];
  const double information = score.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR);
  const double step = score.score[LOG_FOCAL_FACTOR] / information;
  EXPECT_NEAR(step, *estimated.posed.images[0].log_focal_factor, 0.2 / std::sqrt(information));
  EXPECT_NEAR(step, 0.003, 5 / std::sqrt(information));
  const double reference_information = reference.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR);
  EXPECT_NEAR(reference_information / information, 1, 0.05);
  const Eigen::Matrix<double, 6, 1> move = step * score.frame_from_correction.col(LOG_FOCAL_FACTOR);
  const Rigid3d &before = fixed.posed.frames[0].frame_from_world, &after = estimated.posed.frames[0].frame_from_world;
  EXPECT_LE((after.translation - before.translation - move.tail<3>()).norm(), 0.1 * move.tail<3>().norm());
  for (size_t frame = 1; frame < scene.posed.frames.size(); ++frame) {
    EXPECT_TRUE(fixed.intrinsics_scores[frame].information.isZero(0)) << "a database frame";
  }
}

INSTANTIATE_TEST_SUITE_P(IntrinsicsScore, Priors, testing::Bool());

TEST(IntrinsicsScore, AllCorrectionsAreFound) {
  const IntrinsicsScore::Vector truth = Corrections(-0.01, 3, -2, 0.01, 20, -60);
  for (const int num_query : {1, 2}) {
    SyntheticTracks scene = MakeTracks(truth, num_query, /*has_priors=*/false, /*noise_px=*/0);
    if (num_query > 1) JoinFrame(0, 1, &scene.posed);  // cameras of a rig share the corrections
    const IntrinsicsScore score = AdjustBundle(scene.posed, scene.tracks, {}).intrinsics_scores[0];
    const IntrinsicsScore::Vector found = score.information.inverse() * score.score;
    // The step is exact to first order.
    for (int i = 0; i < NUM_INTRINSICS_PARAMETERS; ++i) EXPECT_NEAR(found[i], truth[i], 0.1 * std::abs(truth[i])) << i;
  }
}

// Returns the mean factor of common errors over scenes whose query is skewed by a fraction.
double MeanCommonErrorFactor(double skew, bool estimates_focal_length) {
  const int num_scenes = 20;
  double sum = 0;
  for (uint32_t seed = 0; seed < num_scenes; ++seed) {
    SyntheticTracksOptions options;
    options.num_query = 1;
    options.num_points = 200;
    options.noise_px = 0.5;
    options.seed = seed;
    SyntheticTracks scene = MakeSyntheticTracks(options);
    for (Track& track : scene.tracks) {
      Observation& observation = track.observations[0].observation;
      Eigen::Vector2d offset = kFocalLengthPx * observation.ray_in_cam.hnormalized();
      offset.x() += skew * offset.y();
      observation = PinholeObservation(offset);
    }
    if (estimates_focal_length) {
      scene.posed.images[0].log_focal_factor = 0;
      scene.tracks = ObservedAtPoints(scene.posed, std::move(scene.tracks));
    }
    sum += AdjustBundle(scene.posed, scene.tracks, {}).intrinsics_scores[0].common_error_factor;
  }
  return sum / num_scenes;
}

TEST(CommonErrorFactor, IsThatOfPatternsWithoutAndWithCommonErrors) {
  for (const bool estimates_focal_length : {false, true}) {
    // Without common errors, the squares q of the five patterns sum to 5 on average, and are 1.2 above it on average of
    // max(q - 5, 0), of which the excess makes 4 * 1.2 / 6. The standard deviation of a mean over 20 scenes is 0.35.
    EXPECT_NEAR(MeanCommonErrorFactor(0, estimates_focal_length), (4 + 5 + 4 * 1.2) / 6, 0.7);
    EXPECT_GT(MeanCommonErrorFactor(0.005, estimates_focal_length), 12);
  }
}

}  // namespace
}  // namespace lazyloc

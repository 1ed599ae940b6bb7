#include "colmap_lazyloc/intrinsics/focal_length.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/initialization/start_selection.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/noise/image_noise.h"
#include "colmap_lazyloc/scene/refs.h"

namespace lazyloc {
namespace {

// The focal length is searched from the given one over this factor to the one times it.
constexpr double kMaxFocalFactor = 3;
// Number of factors on each side of 1. Neighbours differ by 8 %, which adjustment corrects.
constexpr int kNumSteps = 14;

// Returns the factors to search, from 1 outwards.
std::vector<double> FocalFactors(const QueryCamera& camera) {
  std::vector<double> factors;
  const auto add_around = [&](double centre) {
    for (int i = 0; i <= 2 * kNumSteps; ++i) {
      const int step = i % 2 == 0 ? i / 2 : -(i + 1) / 2;
      const double factor = centre * std::pow(kMaxFocalFactor, static_cast<double>(step) / kNumSteps);
      if (centre == 1 || std::abs(std::log(factor)) > std::log(kMaxFocalFactor)) factors.push_back(factor);
    }
  };
  add_around(1);
  if (camera.Origin() == IntrinsicsOrigin::EXIF) add_around(FactorToGuess(camera.Intrinsics()));
  return factors;
}

// Returns the errors of the points' projections in pixels; half the image's diagonal behind the camera.
std::vector<double> ErrorsPx(const Refined& estimate, const std::vector<Track>& tracks) {
  const Rigid3d cam_from_world = CamFromWorld(estimate.adjustment.posed, 0);
  std::vector<double> errors_px;
  for (const Track& track : estimate.camera->Observe(tracks)) {
    const Observation& observation = track.observations.front().observation;
    const Eigen::Vector3d point_in_cam = cam_from_world * track.point_in_world;
    errors_px.push_back(IsInFront(observation, point_in_cam) ? ReprojectionError(observation, point_in_cam).norm()
                                                             : HalfDiagonalPx(estimate.camera->Intrinsics()));
  }
  return errors_px;
}

}  // namespace

bool HasFocalLength(const Camera& camera) { return !SameIntrinsics(WithFocalFactor(camera, 2), camera); }

double FactorToGuess(const Camera& camera) {
  return GuessFocalLengthPx(camera.width, camera.height) / MeanFocalLength(camera);
}

bool IsFocalLengthUnknown(const LocalizationProblem& problem, const LocalizerOptions& options) {
  if (options.intrinsics == IntrinsicsMode::GIVEN || !HasFocalLength(problem.query_camera)) return false;
  return options.intrinsics == IntrinsicsMode::REFINE || !IsOfThisCamera(problem.intrinsics_origin);
}

FocalLengthAndPose ChooseFocalLengthAndPose(const Layout& layout, const QueryCamera& camera,
                                            const std::vector<Track>& tracks_from_database,
                                            const LocalizerOptions& options) {
  const double max_error_px = kMaxStartErrorPx;
  const uint32_t seed = SeedFromNames(layout.names[0], "", options.seed);
  const double num_tracks = static_cast<double>(std::max<size_t>(tracks_from_database.size(), 1));
  const TrackRefs no_other_tracks;  // not used, because any focal length fits an epipolar line
  double best_score = 0;
  FocalLengthAndPose best;
  for (const double factor : FocalFactors(camera)) {
    QueryCamera scaled = camera;
    scaled.ScaleFocalLength(factor);
    const std::vector<Track> tracks = scaled.Observe(tracks_from_database);
    const TrackRefs from_database = Refs(tracks);
    // Half the inliers of the best so far, because RANSAC need not search for a pose that does not win.
    const double min_inlier_ratio = std::max(0.1, 0.5 * best_score / num_tracks);
    const StartProblem problem{layout.given, from_database, no_other_tracks, max_error_px, min_inlier_ratio};
    const std::optional<Rigid3d> pose = AbsolutePoseStart(problem, seed);
    if (!pose) continue;
    const double score = ScoreStart(problem, *pose);
    if (score <= best_score) continue;
    best_score = score;
    best = {factor, *pose};
  }
  if (best_score > 0) return best;
  throw Failure{QueryStatus::TOO_FEW_TRACKS, "no focal length explains the " +
                                                 std::to_string(tracks_from_database.size()) +
                                                 " points that two or more database images triangulate"};
}

Refined MostLikelyFocalLength(std::vector<Refined> estimates, const std::vector<Track>& tracks_from_database,
                              const LocalizerOptions& options) {
  std::vector<std::vector<double>> errors_px;
  double noise_px = std::numeric_limits<double>::infinity();
  for (const Refined& estimate : estimates) {
    errors_px.push_back(ErrorsPx(estimate, tracks_from_database));
    if (!errors_px.back().empty()) noise_px = std::min(noise_px, StddevOfLengths(errors_px.back()));
  }
  noise_px = std::max(noise_px, kMinImageNoisePx);
  const RobustLoss loss(options.bundle_adjustment.loss_scale_sigma);
  std::vector<double> costs;
  for (const std::vector<double>& errors : errors_px) {
    RobustLoss::Sum sum(loss);
    for (const double error_px : errors) sum.Add(std::pow(error_px / noise_px, 2));
    costs.push_back(sum.Value());
  }
  const size_t best = std::min_element(costs.begin(), costs.end()) - costs.begin();
  double sum_of_squares = 0;
  for (const Refined& estimate : estimates) {
    sum_of_squares += std::pow(std::log(estimate.camera->FocalFactor() / estimates[best].camera->FocalFactor()), 2);
  }
  estimates[best].log_focal_scatter = sum_of_squares / static_cast<double>(std::max<size_t>(estimates.size() - 1, 1));
  return std::move(estimates[best]);
}

}  // namespace lazyloc

#include "colmap_lazyloc/epoch/adjustment_rounds.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "colmap_lazyloc/bridge/joint_adjustment.h"
#include "colmap_lazyloc/bridge/joint_triangulation.h"
#include "colmap_lazyloc/epoch/database_errors.h"
#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

constexpr int kNumRounds = 3;
// Poses of photos that were localized alone are off by pixels at their neighbours' points.
constexpr double kStartMaxErrorPx = 8;
constexpr double kMinMaxErrorPx = 2;  // of later rounds
constexpr double kMaxErrorSigma = 5;
constexpr size_t kMinNumObservations = 15;  // of an image that is adjusted
constexpr double kMinNoisePx = 0.2;
// Maximum number of observations of a photo in points that are adjusted: the longest tracks determine poses, and time
// grows with the points.
constexpr size_t kMaxNumStartObservations = 500, kMaxNumObservations = 2000;
// Number of observations that the common noise counts as in an image's estimate.
constexpr double kNumCommonObservations = 20;
// Of rounds whose poses are only where the next one starts.
constexpr double kStartMinCostChangeRatio = 1e-5;
constexpr int kMaxNumPointIterations = 5;  // because points are already near where they fit

// Removes observations with errors above both bounds, those of images with too few, and points with fewer than two.
void RemoveMisfits(double max_error_px, JointScene* scene) {
  std::vector<size_t> counts(scene->images.size(), 0);
  for (JointPoint& point : scene->points) {
    std::vector<JointObservation> fitting;
    for (const JointObservation& observation : point.observations) {
      const double bound = std::max(max_error_px, kMaxErrorSigma * scene->images[observation.image].noise_px);
      if (ReprojectionErrorPx(*scene, point, observation) <= bound) fitting.push_back(observation);
    }
    point.observations = fitting.size() < 2 ? std::vector<JointObservation>() : std::move(fitting);
    for (const JointObservation& observation : point.observations) ++counts[observation.image];
  }
  const auto is_alone = [&](const JointObservation& observation) {
    return !scene->images[observation.image].is_database && counts[observation.image] < kMinNumObservations;
  };
  for (JointPoint& point : scene->points) {
    auto& observations = point.observations;
    observations.erase(std::remove_if(observations.begin(), observations.end(), is_alone), observations.end());
  }
  const auto is_lost = [](const JointPoint& point) { return point.observations.size() < 2; };
  scene->points.erase(std::remove_if(scene->points.begin(), scene->points.end(), is_lost), scene->points.end());
}

// Keeps the points with the most observations, as long as a photo that observes them has not enough.
void KeepLongestTracks(size_t max_num_observations, JointScene* scene) {
  std::stable_sort(scene->points.begin(), scene->points.end(), [](const JointPoint& a, const JointPoint& b) {
    return a.observations.size() > b.observations.size();
  });
  std::vector<size_t> counts(scene->images.size(), 0);
  const auto is_superfluous = [&](const JointPoint& point) {
    const bool is_needed = std::any_of(point.observations.begin(), point.observations.end(), [&](const auto& element) {
      return !scene->images[element.image].is_database && counts[element.image] < max_num_observations;
    });
    if (!is_needed) return true;
    for (const JointObservation& observation : point.observations) ++counts[observation.image];
    return false;
  };
  std::vector<JointPoint> kept;
  for (JointPoint& point : scene->points) {
    if (!is_superfluous(point)) kept.push_back(std::move(point));
  }
  scene->points = std::move(kept);
}

// Estimates the noise of each image by the median of its errors, with what the points absorb of them, shrunk towards
// the noise of all images if it has few observations.
void EstimateNoise(JointScene* scene) {
  std::vector<std::vector<double>> lengths(scene->images.size());
  std::vector<double> all;
  for (const JointPoint& point : scene->points) {
    const double num_errors = 2 * static_cast<double>(point.observations.size());
    if (point.observations.size() < 3) continue;
    const double absorbed = std::sqrt((num_errors - 3) / num_errors);
    for (const JointObservation& observation : point.observations) {
      const double length = ReprojectionErrorPx(*scene, point, observation) / absorbed;
      if (!std::isfinite(length)) continue;
      lengths[observation.image].push_back(length);
      all.push_back(length);
    }
  }
  if (all.empty()) return;
  const double common = StddevOfLengths(all);
  for (size_t i = 0; i < scene->images.size(); ++i) {
    const auto count = static_cast<double>(lengths[i].size());
    const double own = lengths[i].empty() ? common : StddevOfLengths(lengths[i]);
    const double variance =
        (count * own * own + kNumCommonObservations * common * common) / (count + kNumCommonObservations);
    scene->images[i].noise_px = std::max(std::sqrt(variance), kMinNoisePx);
  }
}

double LargestNoisePx(const JointScene& scene) {
  double largest = 0;
  for (const JointImage& image : scene.images) largest = std::max(largest, image.noise_px);
  return largest;
}

// Adds the control points that have marks behind the other points.
void AddControlPoints(const ControlMarks& control, JointScene* scene) {
  for (const JointPoint& point : control.points) {
    if (!point.observations.empty()) scene->points.push_back(point);
  }
}

// Takes them from the points again, with their adjusted places.
void RemoveControlPoints(JointScene* scene, ControlMarks* control) {
  for (auto point = control->points.rbegin(); point != control->points.rend(); ++point) {
    if (point->observations.empty()) continue;
    point->point_in_world = scene->points.back().point_in_world;
    scene->points.pop_back();
  }
}

// Moves the points to where they fit the poses best, which stay.
void AdjustPoints(JointScene* scene) {
  JointAdjustmentOptions options;
  options.max_num_iterations = kMaxNumPointIterations;
  options.adjusts_only_points = true;
  AdjustJointly(options, scene);
}

}  // namespace

AdjustedPhotos AdjustInRounds(JointScene* scene) {
  DatabaseErrors errors(*scene);
  JointAdjustment adjustment;
  ControlMarks control;
  double max_error_px = kStartMaxErrorPx;
  for (int round = 0; round < kNumRounds; ++round) {
    scene->points = TriangulateJointly(*scene, max_error_px);
    RemoveMisfits(max_error_px, scene);
    const bool is_last = round + 1 == kNumRounds;
    KeepLongestTracks(is_last ? kMaxNumObservations : kMaxNumStartObservations, scene);
    if (round > 0) {
      control = FindFittingMarks(*scene);
      AddControlPoints(control, scene);
      errors.SetPriors(scene);
    }
    JointAdjustmentOptions adjustment_options;
    adjustment_options.computes_information = round > 0;
    if (!is_last) adjustment_options.min_cost_change_ratio = kStartMinCostChangeRatio;
    adjustment = AdjustJointly(adjustment_options, scene);
    RemoveControlPoints(scene, &control);
    if (!adjustment.summary.success) return {adjustment.summary, {}, {}, false};
    if (round > 0 && !is_last) errors.Estimate(*scene, adjustment);
    EstimateNoise(scene);
    max_error_px = std::clamp(kMaxErrorSigma * LargestNoisePx(*scene), kMinMaxErrorPx, kStartMaxErrorPx);
  }
  const bool control_fits = FitAdjustedScene(control, *scene);
  const AdjustedPhotos photos{adjustment.summary, errors.PhotoCovariances(*scene, adjustment), std::move(control),
                              control_fits};
  if (scene->control_points.empty()) {
    errors.ReturnToGivenDatabase(adjustment, scene);
    AdjustPoints(scene);
    RemoveMisfits(0, scene);
  } else {
    AdjustPoints(scene);  // to the photos, which do not return
    errors.ReturnToGivenDatabase(adjustment, scene);
  }
  return photos;
}

}  // namespace lazyloc

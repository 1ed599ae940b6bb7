#include "colmap_lazyloc/noise/image_noise.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

// Weight of the common noise in that of an image, in tracks.
constexpr double kNumShrinkageTracks = 20;

// Shrinks an image's own noise towards the common noise.
double ShrunkNoisePx(std::vector<double> errors_px, double common_px) {
  if (errors_px.empty()) return common_px;
  const double num_tracks = static_cast<double>(errors_px.size());
  const double own_px = StddevOfLengths(std::move(errors_px));
  return std::exp(
      (num_tracks * std::log(std::max(own_px, 1e-9)) + kNumShrinkageTracks * std::log(std::max(common_px, 1e-9))) /
      (num_tracks + kNumShrinkageTracks));
}

// Returns the common noise of images that have only tracks of two observations, from those with a depth: one degree of
// freedom is left of each. Returns the present noise without such tracks.
std::vector<double> EstimateNoiseByDepths(const PosedImages& posed, const std::vector<Track>& tracks,
                                          double min_noise_px, std::vector<double> present_px) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  std::vector<double> errors_px;
  for (const Track& track : tracks) {
    double squared_error_px = 0;
    bool has_depth = false;
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.image] * track.point_in_world;
      squared_error_px += ReprojectionError(element.observation, point_in_cam).squaredNorm();
      has_depth = has_depth || (element.depth > 0 && posed.images[element.image].depth_scale);
    }
    if (has_depth) errors_px.push_back(std::sqrt(squared_error_px) / track.noise_ratio);
  }
  if (errors_px.empty()) return present_px;
  const double noise_px = StddevOfSizes(std::move(errors_px));
  return std::vector<double>(present_px.size(), std::max(noise_px, min_noise_px));
}

}  // namespace

std::vector<double> EstimateImageNoise(const PosedImages& posed, const std::vector<Track>& tracks,
                                       double min_noise_px) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  std::vector<std::vector<double>> errors_px(posed.images.size());
  std::vector<double> all_px;
  for (const Track& track : tracks) {
    const double num_residuals = 2.0 * static_cast<double>(track.observations.size());
    if (num_residuals <= 4) continue;  // the point takes up nearly all degrees of freedom
    const double correction = std::sqrt(num_residuals / (num_residuals - 3)) / track.noise_ratio;
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.image] * track.point_in_world;
      const double error_px = correction * ReprojectionError(element.observation, point_in_cam).norm();
      errors_px[element.image].push_back(error_px);
      if (posed.IsDatabase(element.image)) all_px.push_back(error_px);
    }
  }
  std::vector<double> noise_px;
  for (const Image& image : posed.images) noise_px.push_back(image.noise_px);
  if (all_px.empty()) return EstimateNoiseByDepths(posed, tracks, min_noise_px, std::move(noise_px));
  const double common_px = StddevOfLengths(std::move(all_px));
  for (size_t image = 0; image < noise_px.size(); ++image) {
    noise_px[image] = std::max(ShrunkNoisePx(std::move(errors_px[image]), common_px), min_noise_px);
  }
  return noise_px;
}

}  // namespace lazyloc

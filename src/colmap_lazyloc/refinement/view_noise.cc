#include "colmap_lazyloc/refinement/view_noise.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/median.h"

namespace lazyloc {
namespace {

// The median of |r| of a two-dimensional normal distribution, in its standard deviation.
constexpr double kMedianOfNorm = 1.17741;
// As many tracks of a view weigh as much as all others together.
constexpr double kNumPriorTracks = 20;

// Median of the chi-square distribution, as a part of its mean (Wilson and Hilferty 1931).
double MedianOfMean(double num_freedoms) { return std::pow(1 - 2 / (9 * num_freedoms), 3); }

}  // namespace

double MeasureSingleViewSpread(const std::vector<Track>& tracks, const std::vector<View>& views) {
  std::vector<double> single, others;
  for (const Track& track : tracks) {
    double squared_error = 0;
    int num_database_views = 0;
    for (const TrackObservation& element : track.observations) {
      const View& view = views[element.view];
      num_database_views += view.is_database;
      const Eigen::Vector3d point_in_cam = view.cam_from_world * track.point_in_world;
      squared_error += ReprojectionError(element.observation, point_in_cam).squaredNorm() / std::pow(view.noise_px, 2);
    }
    const double num_freedoms = 2.0 * static_cast<double>(track.observations.size()) - 3;
    (num_database_views > 1 ? others : single).push_back(squared_error / (num_freedoms * MedianOfMean(num_freedoms)));
  }
  if (single.empty() || others.empty()) return 1;
  const double num_tracks = static_cast<double>(single.size());
  const double spread = Median(std::move(single)) / std::max(Median(std::move(others)), 1e-18);
  return std::pow(std::max(spread, 1.0), num_tracks / (num_tracks + kNumPriorTracks));
}

void EstimateViewNoise(const std::vector<Track>& tracks, double min_noise_px, std::vector<View>* views) {
  std::vector<std::vector<double>> errors_px(views->size());
  std::vector<double> all_px;
  for (const Track& track : tracks) {
    const double num_residuals = 2.0 * static_cast<double>(track.observations.size());
    if (num_residuals <= 4) continue;  // the point takes up nearly everything
    const double correction = std::sqrt(num_residuals / (num_residuals - 3)) / track.noise_ratio;
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = (*views)[element.view].cam_from_world * track.point_in_world;
      const double error_px = correction * ReprojectionError(element.observation, point_in_cam).norm();
      errors_px[element.view].push_back(error_px);
      if ((*views)[element.view].is_database) all_px.push_back(error_px);
    }
  }
  if (all_px.empty()) return;
  const double common = Median(std::move(all_px)) / kMedianOfNorm;
  for (size_t view = 0; view < views->size(); ++view) {
    const double num_tracks = static_cast<double>(errors_px[view].size());
    double noise_px = common;
    if (num_tracks > 0) {
      const double own = Median(std::move(errors_px[view])) / kMedianOfNorm;
      noise_px =
          std::exp((num_tracks * std::log(std::max(own, 1e-9)) + kNumPriorTracks * std::log(std::max(common, 1e-9))) /
                   (num_tracks + kNumPriorTracks));
    }
    (*views)[view].noise_px = std::max(noise_px, min_noise_px);
  }
}

}  // namespace lazyloc

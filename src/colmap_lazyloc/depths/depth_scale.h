#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/depth_result.h"

namespace lazyloc {

// Minimum relative standard deviation of a depth, and relative standard deviation of a metric map's scale, as
// calibrated sensors have them.
inline constexpr double kMinDepthStddev = 0.01, kMetricScaleStddev = 0.02;

// A triangulated point in an image with a depth map.
struct DepthSample {
  double map_depth = 0;
  double point_depth = 0;
  Eigen::Vector2d place;  // keypoint over the size of the image, 0 to 1
};

// How the depths of a map differ from those of triangulated points: log(point) = log(map) + log_scale + error.
// The error is the sum of one that neighbouring pixels share and an independent one.
struct DepthFit {
  double log_scale = 0;
  double stddev = 0;           // robust standard deviation of the error
  double scale_variance = 0;   // of log_scale
  double pixel_variance = 0;   // of the independent error
  double common_variance = 0;  // of the mean of the shared error over the image
  DepthVerdict verdict = DepthVerdict::NO_SCALE;
  int num_points = 0;
  bool is_metric = false;  // true if log_scale rests on a statement that the map is metric
};

// Fits the scale of a map robustly. The verdict is NO_SCALE for too few points, and
// CONTRADICTED if the depths scatter by more than a fifth, or are not correlated with those of the points.
DepthFit FitDepthMap(const std::vector<DepthSample>& samples);

// Returns the fit of a map that is stated to be metric. own: fit to points that database images triangulate; relative:
// fit to points whose common scale is unknown, which tell only how exact the map is.
DepthFit FitMetricDepthMap(const DepthFit& own, const DepthFit& relative);

}  // namespace lazyloc

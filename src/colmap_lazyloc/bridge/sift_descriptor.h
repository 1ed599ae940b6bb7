#pragma once

#include <array>

#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Gradients of an image: magnitude and angle in [0, 2 pi] of each pixel, row by row.
struct GradientImage {
  const float* values = nullptr;
  int width = 0, height = 0;
};

// A keypoint in pixels of the gradients.
struct SiftKeypoint {
  double x = 0, y = 0;
  double scale = 0;
  double orientation_rad = 0;
};

// Sets magnitude and angle of each pixel's gradient, with VLFeat's approximations of the square root and the arc
// tangent. image: width * height values, row by row; gradients: as in GradientImage. Uses idle threads, too.
void ComputeGradients(const float* image, int width, int height, IdleThreads* idle_threads, float* gradients);

constexpr int kNumSpatialBins = 4, kNumAngularBins = 8;
using SiftHistogram = std::array<float, kNumSpatialBins * kNumSpatialBins * kNumAngularBins>;

// Returns the SIFT descriptor of a keypoint: sums of gradients in 4 x 4 x 8 bins, of length 1, limited to 0.2, and of
// length 1 again. Takes each step like VLFeat, so that the bits are the same, but only where a gradient has a bin.
SiftHistogram DescribeKeypoint(const GradientImage& gradients, const SiftKeypoint& keypoint);

}  // namespace lazyloc

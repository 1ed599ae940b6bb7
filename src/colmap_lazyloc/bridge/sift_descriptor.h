#pragma once

#include <array>
#include <vector>

#include "colmap_lazyloc/bridge/sift_level.h"

namespace lazyloc {

// Returns the orientations of a keypoint in radians, at most 4: the maxima of a histogram of the gradients around it.
// Takes each step like VLFeat, so that the bits are the same.
std::vector<double> FindOrientations(const SiftLevel& level, const SiftKeypoint& keypoint);

constexpr int kNumSpatialBins = 4, kNumAngularBins = 8;
using SiftHistogram = std::array<float, kNumSpatialBins * kNumSpatialBins * kNumAngularBins>;

// Returns the SIFT descriptor of a keypoint: sums of gradients in 4 x 4 x 8 bins, of length 1, limited to 0.2, and of
// length 1 again. Takes each step like VLFeat, so that the bits are the same, but only where a gradient has a bin.
SiftHistogram DescribeKeypoint(const SiftLevel& level, const SiftKeypoint& keypoint, double orientation_rad);

}  // namespace lazyloc

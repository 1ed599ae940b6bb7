#pragma once

#include <algorithm>
#include <cmath>
#include <random>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Returns random descriptors like those of SIFT: 128 columns, norm 512, a few large elements.
inline Descriptors RandomDescriptors(int num_rows, uint32_t seed) {
  std::mt19937 random(seed);
  Descriptors descriptors(num_rows, 128);
  for (Eigen::Index row = 0; row < num_rows; ++row) {
    Eigen::RowVectorXd values(128);
    for (double& value : values) value = std::pow(static_cast<double>(random()) / 4294967296.0, 4);
    values *= 512 / values.norm();
    descriptors.row(row) = values.array().round().min(255).cast<uint8_t>();
  }
  return descriptors;
}

// Returns the descriptors with uniform noise in [-2, 2] in every element.
inline Descriptors WithNoise(Descriptors descriptors, uint32_t seed) {
  std::mt19937 random(seed);
  for (Eigen::Index i = 0; i < descriptors.size(); ++i) {
    const int value = descriptors.data()[i] + static_cast<int>(random() % 5) - 2;
    descriptors.data()[i] = static_cast<uint8_t>(std::clamp(value, 0, 255));
  }
  return descriptors;
}

}  // namespace lazyloc

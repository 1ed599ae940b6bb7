#pragma once

#include <vector>

namespace lazyloc {

// values: positive, at least one.
inline double HarmonicMean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += 1 / value;
  return static_cast<double>(values.size()) / sum;
}

}  // namespace lazyloc

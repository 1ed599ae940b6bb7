#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace lazyloc {

// Scale of the robust losses of all stages, in standard deviations of the error.
inline constexpr double kLossScaleSigma = 2;

// Returns the upper median. values: at least one.
inline double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// values: positive, at least one.
inline double HarmonicMean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += 1 / value;
  return static_cast<double>(values.size()) / sum;
}

// The following return the standard deviation of a normal distribution by a median, which false matches hardly change.

// sizes: absolute values of errors with a mean of zero, at least one.
inline double StddevOfSizes(std::vector<double> sizes) { return 1.4826 * Median(std::move(sizes)); }

// lengths: of two-dimensional errors with a mean of zero, at least one. The standard deviation is per coordinate.
inline double StddevOfLengths(std::vector<double> lengths) { return Median(std::move(lengths)) / 1.17741; }

// values: of any mean, at least one.
inline double RobustStddev(std::vector<double> values) {
  const double middle = Median(values);
  for (double& value : values) value = std::abs(value - middle);
  return StddevOfSizes(std::move(values));
}

}  // namespace lazyloc

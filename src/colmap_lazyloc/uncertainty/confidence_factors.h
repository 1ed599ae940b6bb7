#pragma once

namespace lazyloc {

// Written by `scripts/python.sh -m benchmarks uncertainty fit`, and moved along its flat maximum
// (docs/benchmarks/uncertainty.md).
// Odds of another place if half of the matches speak for the pose and its points fit within a pixel.
inline constexpr double kPlaceOdds = 0.34;
// Number of points with which chance is as probable as the pose.
inline constexpr double kChanceNumPoints = 2.0;

}  // namespace lazyloc

#pragma once

namespace lazyloc {

// Written by `scripts/python.sh -m benchmarks uncertainty fit` (docs/benchmarks/uncertainty.md).
// Odds of another place if half of the matches speak for the pose and its points fit within a pixel.
inline constexpr double kPlaceOdds = 0.26;
// Odds of a competing pose with the same score.
inline constexpr double kCompetingOdds = 0.31;
// Number of points with which chance is as probable as the pose.
inline constexpr double kChanceNumPoints = 1.9;

}  // namespace lazyloc

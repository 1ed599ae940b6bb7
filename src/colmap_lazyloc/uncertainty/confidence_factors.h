#pragma once

namespace lazyloc {

// Written by `scripts/python.sh -m benchmarks uncertainty fit` (docs/benchmarks/uncertainty.md).
// Odds of another place if the pose explains half of the matches, with a median error of a pixel.
inline constexpr double kPlaceOdds = 0.24;
// Odds of a competing pose with the same score.
inline constexpr double kCompetingOdds = 0.17;
// Number of points with which chance is as probable as the pose.
inline constexpr double kChanceNumPoints = 1.7;

}  // namespace lazyloc

#pragma once

#include <array>

#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// One addend of the log odds that a position is right: weight * (value - typical), or weight * log(value / typical).
struct ConfidenceTerm {
  double PoseEvidence::*evidence;
  bool is_logarithmic;
  double min, max;  // the value is clamped to this range
  double typical;   // median over right poses
  double weight;
};

// Written by `scripts/python.sh -m benchmarks uncertainty fit`; docs/method.md says why these terms.
inline constexpr double kTypicalLogOdds = 5.754;
inline constexpr std::array<ConfidenceTerm, 6> kConfidenceTerms = {{
    {&PoseEvidence::num_common_tracks, true, 1, 30, 30, 0.5461},
    {&PoseEvidence::explained_ratio, false, 0, 0.6, 0.6, 8.501},
    {&PoseEvidence::agreeing_ratio, false, 0, 0.6, 0.6, 1.791},
    {&PoseEvidence::median_error_px, true, 0.3, 10, 0.3, -1.446},
    {&PoseEvidence::position_stddev_ratio, true, 0.003, 0.1, 0.003, -0.761},
    {&PoseEvidence::start_distance_ratio, true, 0.01, 1, 0.01, -0.7065},
}};

}  // namespace lazyloc

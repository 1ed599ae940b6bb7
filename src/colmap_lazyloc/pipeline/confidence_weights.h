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
inline constexpr double kTypicalLogOdds = 5.198;
inline constexpr std::array<ConfidenceTerm, 7> kConfidenceTerms = {{
    {&PoseEvidence::num_common_tracks, true, 1, 30, 30, 0.4185},
    {&PoseEvidence::explained_ratio, false, 0, 0.6, 0.6, 5.916},
    {&PoseEvidence::agreeing_ratio, false, 0, 0.6, 0.6, 1.727},
    {&PoseEvidence::median_error_px, true, 0.3, 10, 0.3, -1.155},
    {&PoseEvidence::position_stddev_ratio, true, 0.003, 0.03, 0.003, -0.7738},
    {&PoseEvidence::start_distance_ratio, true, 0.01, 1, 0.01, -1.091},
    {&PoseEvidence::focal_stddev_ratio, true, 0.008, 0.03, 0.008, -3.795},
}};

}  // namespace lazyloc

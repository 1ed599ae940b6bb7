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
inline constexpr double kTypicalLogOdds = 4.99;
inline constexpr std::array<ConfidenceTerm, 10> kConfidenceTerms = {{
    {&PoseEvidence::num_common_tracks, true, 1, 30, 30, 0.5048},
    {&PoseEvidence::explained_ratio, false, 0, 0.6, 0.6, 5.676},
    {&PoseEvidence::agreeing_ratio, false, 0, 0.6, 0.6, 1.411},
    {&PoseEvidence::median_error_px, true, 0.1, 10, 0.2068, -0.7796},
    {&PoseEvidence::mean_error_px, true, 4, 30, 4, -1.901},
    {&PoseEvidence::mean_track_length, true, 2, 6, 3.612, 2.711},
    {&PoseEvidence::rotation_stddev_deg, true, 0.3, 1, 0.3, -1.647},
    {&PoseEvidence::rotation_position_ratio, true, 0.3, 2, 0.6183, 0.9014},
    {&PoseEvidence::start_distance_ratio, true, 0.01, 1, 0.01, -0.2124},
    {&PoseEvidence::focal_stddev_ratio, true, 0.008, 0.03, 0.008, -3.119},
}};

}  // namespace lazyloc

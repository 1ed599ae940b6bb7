#pragma once

#include <array>
#include <vector>

#include "colmap_lazyloc/bridge/sift_pyramid.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Keypoints of each level of an octave, from kFirstKeypointLevel on.
using OctaveKeypoints = std::array<std::vector<SiftKeypoint>, kNumKeypointLevels>;

// Returns the keypoints of an octave, row by row: extrema of the differences of its levels in space and scale. Takes
// each step like VLFeat, so that the bits are the same, but stores no differences. Uses idle threads, too.
OctaveKeypoints DetectKeypoints(const SiftOctave& octave, double peak_threshold, double edge_threshold,
                                IdleThreads* idle_threads);

}  // namespace lazyloc

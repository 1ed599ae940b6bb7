#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "colmap_lazyloc/bridge/sift_level.h"
#include "colmap_lazyloc/math/large_array.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// An octave has six levels, each smoother than the one before. A keypoint is an extremum of the difference of two
// levels, compared with the differences before and after: of differences 1 to 3.
constexpr int kNumLevels = 6;
constexpr int kFirstKeypointLevel = 1, kNumKeypointLevels = 3;  // the latter is COLMAP's octave_resolution
// The last two levels are needed to detect keypoints only, so that they are computed for some rows at a time.
constexpr int kNumStoredLevels = 4;

struct SiftOctave {
  int index = 0;  // its pixels have 2^index pixels of the image
  int width = 0, height = 0;
  std::array<LargeArray, kNumStoredLevels> levels;

  SiftLevel Level(int level) const { return {levels[static_cast<size_t>(level)].get(), width, height}; }
};

// Returns the scale of a keypoint in pixels of the octave. levels_from_first: how many levels it is after the first
// keypoint's level, rarely an integer.
double ScaleOfLevel(double levels_from_first);
// Returns the standard deviation in pixels that the smoothing from the level before has.
double LevelSmoothing(int level);

// Returns the octaves of an image, the finest first. grey: width * height values, row by row. Takes each step like
// VLFeat, so that the bits are the same. Uses idle threads, too.
std::vector<SiftOctave> MakeOctaves(const std::vector<uint8_t>& grey, int width, int height, int first_octave,
                                    int num_octaves, IdleThreads* idle_threads);

}  // namespace lazyloc

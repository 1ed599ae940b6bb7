#pragma once

#include <array>
#include <vector>

#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

// Source of the expected size of the errors of database poses.
enum class PoseNoiseSource {
  DEFAULT,         // that of a typical database
  STATED,          // the options state it
  DATABASE_PAIRS,  // matches of database images with each other show it
};
template <>
inline constexpr std::array<const char*, 3> kEnumNames<PoseNoiseSource> = {"default", "stated", "database_pairs"};

// Errors of database poses as they are expected before the query's own images are used, in pixels.
struct DatabasePoseNoise {
  PoseNoiseSource source = PoseNoiseSource::DEFAULT;
  int num_pairs = 0;  // of database images that show the size
  // Sizes of the errors that change between viewpoints 11.5 degrees apart, and of independent rotations and
  // positions. Zero if standard deviations of the poses are stated.
  double viewpoint_px = 0, rotation_px = 0, position_px = 0;
};

// What is expected of a variance component before the adjustment: the log of its standard deviation is normally
// distributed.
struct ExpectedStddev {
  double median = 1;
  double log_stddev = 1;
  double min = 0.01;
  double first = 1;  // where the search for the maximum starts
};

// What is expected of the errors of database poses: the sizes in pixels of those that change with the viewpoint, of
// independent rotations and of independent positions.
struct ExpectedPoseErrors {
  DatabasePoseNoise AsResult() const {
    if (sizes.empty()) return {source, num_pairs};
    return {source, num_pairs, sizes[0].median, sizes[1].median, sizes[2].median};
  }

  std::vector<ExpectedStddev> sizes;
  PoseNoiseSource source = PoseNoiseSource::DEFAULT;
  int num_pairs = 0;  // of database images that tell the sizes
};

}  // namespace lazyloc

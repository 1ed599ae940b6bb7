#pragma once

#include <vector>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// The defaults of COLMAP's incremental triangulator.
struct ColmapTriangulationOptions {
  double max_angular_error_deg = 2;  // between the ray of an observation and the point
  double min_triangulation_angle_deg = 1.5;
};

// Triangulates each track by COLMAP from all its rays, those of queries too (bridge/triangulation.h), and removes the
// observations that do not agree. Leaves out tracks without a point, or that no query or no other image is left to
// observe. Keeps the order.
std::vector<Track> TriangulateWithColmap(const PosedImages& posed, std::vector<Track> tracks,
                                         const ColmapTriangulationOptions& options = {});

}  // namespace lazyloc

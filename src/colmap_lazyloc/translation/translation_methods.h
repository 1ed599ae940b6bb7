#pragma once

#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

inline constexpr int kMaxNumTranslationIterations = 50;  // far more than a solve takes

// Returns the vector from the first to the second image of an edge.
inline Eigen::Vector3d Baseline(const DirectionEdge& edge, const std::vector<Eigen::Vector3d>& centres) {
  return centres[edge.node2] - centres[edge.node1] + edge.offset_in_world;
}

// Returns the noise of an edge, with that of errors that the rays do not show.
double EdgeStddevRad(const DirectionEdge& edge);

}  // namespace lazyloc

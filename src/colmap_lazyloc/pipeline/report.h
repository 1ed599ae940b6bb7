#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Fills the result's points, their number, that of their observations, and the mean reprojection errors. View 0 is the
// query, view i + 1 is pair i. origin: what was subtracted from the world's coordinates.
void ReportTracks(const std::vector<View>& views, const std::vector<Track>& tracks, const Eigen::Vector3d& origin,
                  LocalizationResult* result);

}  // namespace lazyloc

#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"

namespace lazyloc {

// Returns for each query of a rig the median reprojection error in pixels of its tracks from the database, at its place
// in the frame; nullopt for single images and queries without such tracks. Throws Failure (with these errors) for
// frames one of whose images fits the points far better by a pose of its own than at its place in the frame, because
// the calibration of the rig, or the trajectory, is then wrong.
std::vector<std::optional<double>> CheckRigs(const Layout& layout, const PosedImages& posed,
                                             const std::vector<Track>& tracks_from_database,
                                             const LocalizerOptions& options);

// Checks the same before positions are known: throws for frames with an image none of whose pairs agree with the
// averaged rotations, but with each other. rotation_errors_rad: by pair.
void CheckRigRotations(const Layout& layout, const PairRefs& pairs, const std::vector<double>& rotation_errors_rad,
                       double max_error_deg);

}  // namespace lazyloc

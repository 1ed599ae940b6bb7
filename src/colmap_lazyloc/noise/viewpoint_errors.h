#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/group/layout.h"

namespace lazyloc {

// Returns the deviations of a group's frames from their priors, in the priors' standard deviations: one frame per row.
Eigen::MatrixXd MeasureDeviations(const PosedImages& adjusted, const PriorGroup& group);

// Expected errors of the database poses at other viewpoints, by the deviations of a group's frames (kriging). All refer
// to one coordinate of the rotations or positions, in the priors' standard deviations.
struct PredictedErrors {
  Eigen::MatrixXd by_rotation, by_position;                // expected error per deviation, by viewpoint and frame
  Eigen::VectorXd rotation_variances, position_variances;  // of the errors around the expected ones, by viewpoint
};
// first: the viewpoint that the deviations are relative to.
PredictedErrors PredictErrors(const PosedImages& adjusted, const PriorGroup& group, const Rigid3d& first,
                              const std::vector<Rigid3d>& viewpoints);

// Expresses the adjusted poses relative to the database poses as given, and to the calibration that the database has
// for its rigs, because a reader of a result compares it with these. Moves the images of query frames, but the first of
// each, from the corrected to the given poses: corrections are relative to the error at the first image's viewpoint,
// and at another viewpoint the given poses have another error, because they drift. Predicts it from the corrections of
// the database frames, as kriging does (DatabasePriors). Leaves out images whose calibration the database has, because
// its rig frames have one error.
PosedImages RelativeToGivenDatabase(const Layout& layout, const PosedImages& adjusted);

}  // namespace lazyloc

#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/query_prior.h"

namespace lazyloc {

// Deviation of an image from a prior of its query, in standard deviations. The jacobian is with respect to the tangent
// (w, dt) of frame_from_world, and to the log of a factor on the translation of cam_from_frame.
struct QueryPriorResidual {
  Eigen::Vector3d error;
  Eigen::Matrix<double, 3, 7> jacobian;
};

// Evaluates the displacement of the projection centre.
QueryPriorResidual EvaluatePositionPrior(const PositionPrior& prior, const Rigid3d& cam_from_frame,
                                         const Rigid3d& frame_from_world);

// Evaluates the cross product of both directions of gravity, whose length is the sine of the angle between them.
QueryPriorResidual EvaluateGravityPrior(const GravityPrior& prior, const Rigid3d& cam_from_frame,
                                        const Rigid3d& frame_from_world);

}  // namespace lazyloc

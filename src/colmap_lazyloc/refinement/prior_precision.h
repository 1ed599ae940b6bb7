#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// Inverse covariance of the deviations of a group's frames from their priors. Deviations in different coordinates do
// not correlate, and the three coordinates of a rotation are alike, as are those of a position.
struct PriorPrecision {
  // Returns the part of the pose that a coordinate of a deviation belongs to (pose_prior.h).
  static PosePart PartOf(Eigen::Index coordinate) { return coordinate < 3 ? PosePart::ROTATION : PosePart::POSITION; }

  const Eigen::MatrixXd& Of(Eigen::Index coordinate) const { return coordinate < 3 ? rotation : position; }
  // Returns the elements of two frames in the six coordinates.
  Eigen::Matrix<double, 6, 1> Between(Eigen::Index a, Eigen::Index b) const {
    Eigen::Matrix<double, 6, 1> elements;
    elements.head<3>().setConstant(rotation(a, b));
    elements.tail<3>().setConstant(position(a, b));
    return elements;
  }

  Eigen::MatrixXd rotation, position;  // of one coordinate, by frame
};

// Return the covariance of the deviations in a coordinate of the rotation or of the position, and its inverse.
Eigen::MatrixXd ComputePriorCovariance(const PriorGroup& group, PosePart part);
Eigen::MatrixXd ComputePriorPrecision(const PriorGroup& group, PosePart part);

PriorPrecision ComputePriorPrecision(const PriorGroup& group);

// Returns the covariance contribution of each component to given linear functions. by_deviations: column j is the gain
// of function j with respect to the deviations; its rows are one coordinate of all frames after the other.
std::vector<Eigen::MatrixXd> ComponentCovariances(const PriorGroup& group, const PriorPrecision& precision,
                                                  const Eigen::MatrixXd& by_deviations);

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/pose_prior.h"

namespace lazyloc {

// Deviation of an adjusted database frame from its prior.
struct PriorDeviation {
  int frame = -1;  // among those of the reduced system
  PosePriorResidual residual;
};

// Tests whether the pose priors were too tight. Tight priors stabilise the pose but make its covariance optimistic; k
// corrects for that: if the variance of the priors is k times and that of the keypoints v times the stated one, the
// corrections u of the database poses, in standard deviations of the priors, have
//   E |u|^2 = k tr (I - W)^2 + v tr (W - W^2),   W their covariance by the adjustment,
// and the frames have the covariance v G + (k - v) G P G, where G is the inverse of the normal equations and P the
// priors' part of these.
struct PriorFit {
  double num_parameters = 0, squared_deviation = 0;  // |u|^2
  double trace = 0, squared_trace = 0;               // tr W, tr W^2

  // Returns k by the equation above, with some further parameters that deviate as the priors state.
  double VarianceFactor(double image_variance_factor) const;
};

// Computes the fit. inverse: G, with frame_size parameters for each frame, the first six of which are the tangent of
// its pose. prior_parts: receives the diagonal blocks of G P G, by frame.
PriorFit FitPriors(const std::vector<PriorDeviation>& deviations, const Eigen::MatrixXd& inverse, int frame_size,
                   std::vector<Eigen::MatrixXd>* prior_parts);

}  // namespace lazyloc

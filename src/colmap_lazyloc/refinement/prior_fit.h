#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/pose_prior.h"

namespace lazyloc {

// A database camera of an adjustment, and how far it was moved from its prior.
struct PriorDeviation {
  int camera = -1;
  PosePriorResidual residual;
};

// What an adjustment says of its priors. Those that it takes for too small steady the queries' poses, but make them
// seem more certain than they are: with the priors' variance k times and the image points' variance v times as large as
// it was told, corrections u of the database's poses, in the priors' standard deviations, have
//   E |u|^2 = k tr (I - W)^2 + v tr (W - W^2),   W their covariance by the adjustment,
// and the cameras have the covariance v G + (k - v) G P G, G being the inverse of the normal equations and P the
// priors' part of these.
struct PriorFit {
  double num_parameters = 0, squared_deviation = 0;  // |u|^2
  double trace = 0, squared_trace = 0;               // tr W, tr W^2

  // k by the equation above, with some parameters more that deviate as the priors say.
  double VarianceFactor(double image_variance_factor) const;
};

// inverse: G; of each camera camera_size parameters, the first six being its pose's tangent. prior_parts: the cameras'
// blocks of G P G.
PriorFit FitPriors(const std::vector<PriorDeviation>& deviations, const Eigen::MatrixXd& inverse, int camera_size,
                   std::vector<Eigen::MatrixXd>* prior_parts);

}  // namespace lazyloc

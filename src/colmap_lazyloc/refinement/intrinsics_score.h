#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/robust_loss.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/intrinsics_parameter.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

template <int kSize>
class BundleSolver;

// The first parameters, which are tested in calibrated cameras. With the fifth power, too, the images would show
// neither.
inline constexpr int kNumTestedIntrinsics = FIFTH_POWER_DISTORTION;

// What the factor of common errors is expected to be before the images are used.
inline constexpr double kCommonErrorFactor = 4;

// The normal equations of corrections of a query frame's intrinsics that an adjustment did not estimate, which all
// cameras of a rig share, at the minimum of an adjustment, with all points and poses eliminated:
// `information` * correction = `score` (Rao's score test). A correction takes the weights of the adjustment.
struct IntrinsicsScore {
  using Matrix = IntrinsicsCovariance;
  using Vector = IntrinsicsCorrections;

  Matrix information = Matrix::Zero();
  Vector score = Vector::Zero();
  // Factor on the covariance that independent errors give `score` and the corrections, because errors that many points
  // of the image share, as with a rolling shutter, suggest other intrinsics without making the images disagree. It
  // grows with the squares, over their variances by independent errors, of displacements that neither a pose nor a
  // correction makes; kCommonErrorFactor counts as one more.
  double common_error_factor = 1;
  // What errors that the matches with a database image share add to the covariance of the frame's parameters: 6x6, or
  // 7x7 with the factor (ClusterCovariance). Tracks with depths do not count.
  Eigen::MatrixXd frame_shared_errors;
  // Factor on the covariance without shared errors: few database images tell the sizes of their errors poorly. 1 if
  // these sizes are known, or if the frame has tracks with depths.
  double small_sample_factor = 1;
  // Derivatives of the tangent of frame_from_world, and of the frame's factor, with respect to the corrections.
  Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS> frame_from_correction =
      Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>::Zero();
  Vector log_factor_from_correction = Vector::Zero();
};

// Returns the score of each frame, zero for database frames. solver: after its minimum; tracks: those it was made of.
// Frames without a common point with the frame in question count as constant, because a large group would otherwise
// need the inverse of the whole system. If the focal length was estimated, its information is that of the estimate and
// its score zero.
template <int kSize>
std::vector<IntrinsicsScore> ComputeIntrinsicsScores(const BundleSolver<kSize>& solver, const PosedImages& posed,
                                                     const std::vector<Track>& tracks, const RobustLoss& loss);

}  // namespace lazyloc

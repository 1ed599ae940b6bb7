#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

template <int kSize>
class BundleSolver;

// What an adjustment says of the deviations p of a prior group's frames.
struct PriorFit {
  Eigen::Matrix<double, Eigen::Dynamic, 6> deviations;  // p, by frame of the group
  // Information of the images on p, without the priors: for image noise as stated, with all points, query poses,
  // calibrations and factors unknown too. One coordinate of all frames after the other. The frames of other prior
  // groups count as constant, because else the equations of all queries would have to be solved for each.
  Eigen::MatrixXd information;
  // Covariance of cam_from_world that unit variance of a component causes, by component and image. Zero for database
  // images.
  std::vector<std::vector<Eigen::Matrix<double, 6, 6>>> component_covariances = {};
};

// Fits a prior group after the minimum of an adjustment that solves a dense system; without component_covariances.
template <int kSize>
PriorFit FitPriors(const BundleSolver<kSize>& solver, size_t group);

// Returns by component and frame of the problem the covariance of the frame's parameters that unit variance of the
// component causes, after BundleSolver::Covariances; empty for frames that are not in needed_frames.
template <int kSize>
std::vector<std::vector<Eigen::MatrixXd>> FrameComponentCovariances(const BundleSolver<kSize>& solver, size_t group,
                                                                    const PriorGroup& given,
                                                                    const std::vector<int>& needed_frames);

extern template PriorFit FitPriors<6>(const BundleSolver<6>&, size_t);
extern template PriorFit FitPriors<7>(const BundleSolver<7>&, size_t);
extern template std::vector<std::vector<Eigen::MatrixXd>> FrameComponentCovariances<6>(const BundleSolver<6>&, size_t,
                                                                                       const PriorGroup&,
                                                                                       const std::vector<int>&);
extern template std::vector<std::vector<Eigen::MatrixXd>> FrameComponentCovariances<7>(const BundleSolver<7>&, size_t,
                                                                                       const PriorGroup&,
                                                                                       const std::vector<int>&);

}  // namespace lazyloc

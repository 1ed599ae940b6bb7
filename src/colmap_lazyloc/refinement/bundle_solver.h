#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/bundle_problem.h"
#include "colmap_lazyloc/refinement/camera_system.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/refinement/robust_loss.h"

namespace lazyloc {

// Unknowns of bundle adjustment.
struct BundleState {
  std::vector<ParameterBlock> frames;
  std::vector<Eigen::Vector3d> points;  // by track
};

// Levenberg-Marquardt with the points eliminated. kSize: number of parameters of a frame (6, or 7 with a factor).
template <int kSize>
class BundleSolver {
 public:
  using FrameVector = Eigen::Matrix<double, kSize, 1>;
  using FrameMatrix = Eigen::Matrix<double, kSize, kSize>;
  using Coupling = Eigen::Matrix<double, kSize, 3>;

  // Factor of a point's damped Hessian H = L L^T, and its gradient g.
  struct PointFactor {
    Eigen::Matrix3d inverse;   // L^-1
    Eigen::Vector3d gradient;  // L^-1 g
  };

  // The damped normal equations around a state with the points eliminated, and what back substitution needs.
  struct System {
    double cost = 0;
    typename CameraSystem<kSize>::Blocks reduced;
    Eigen::VectorXd rhs;
    std::vector<PointFactor> point_factors;
    std::vector<Coupling> eliminated;  // by free observation: its coupling times the inverse factor, transposed
  };

  BundleSolver(const PosedImages& posed, const std::vector<Track>& tracks, const BundleAdjustmentOptions& options);

  // Takes a damped step, then Gauss-Newton steps while they lower the cost; increases the damping when they do not.
  StageSummary Minimize();
  const BundleState& Solution() const { return state_; }
  const BundleProblem& Problem() const { return problem_; }
  // Return the last normal equations, where their blocks are, and the state that they were built around: the solution,
  // or the last step before it.
  const System& Equations() const { return system_; }
  const CameraSystem<kSize>& Cameras() const { return camera_system_; }
  const BundleState& Linearization() const { return before_last_step_ ? *before_last_step_ : state_; }
  // Returns the covariances of the frames' parameters, at the minimum or the last step before it, which is as short
  // as convergence means.
  std::vector<FrameMatrix> Covariances() const;
  PosePriorResidual EvaluatePrior(int frame, const BundleState& state) const {
    return EvaluatePosePrior(*problem_.pose_priors[frame], state.frames[frame].frame_from_world);
  }

 private:
  // Builds the system around a state. Returns false if a point lies behind one of its cameras.
  bool Build(const BundleState& state, double damping);
  // Returns the cost of a state without building its system; infinite if a point lies behind one of its cameras.
  double Cost(const BundleState& state) const;
  void AddPriors(const BundleState& state, std::vector<FrameMatrix>* frame_hessians);
  void AddFlex(const BundleState& state, const BundleFlex& flex, std::vector<FrameMatrix>* frame_hessians);
  void AddDepthMapPriors(const BundleState& state, std::vector<FrameMatrix>* frame_hessians);
  // Evaluates the depth of a track's point that a coupling stands for. Returns false if the point lies behind its
  // image.
  bool Evaluate(const BundleState& state, const FreeObservation& coupling, size_t track, DepthError* error) const;
  // Adds the derivatives of this depth by frame and scale; the error is weighted.
  void AddDepth(const DepthError& error, size_t coupling, size_t track, std::vector<FrameMatrix>* frame_hessians);
  void AddQueryPriors(const BundleState& state, std::vector<FrameMatrix>* frame_hessians);
  // Adds a track's derivatives and eliminates its point, in one pass. Returns false if the point lies behind a camera.
  bool AddTrack(const BundleState& state, size_t track, double damping, std::vector<FrameMatrix>* frame_hessians);
  // Subtracts the Schur complement of one point by its Cholesky factor: a square, so that the system stays positive
  // definite however badly the point is determined. system_.eliminated holds the couplings before the call.
  void EliminatePoint(size_t track, const Eigen::Matrix3d& hessian, const Eigen::Vector3d& gradient);
  // Returns the length of the frames' step in standard deviations (Mahalanobis distance by the reduced system), root
  // mean square over the frames; NaN if the system is not positive definite.
  double Step(BundleState* next);

  const BundleAdjustmentOptions& options_;
  const RobustLoss loss_;
  const BundleProblem problem_;
  CameraSystem<kSize> camera_system_;
  BundleState state_;
  std::optional<BundleState> before_last_step_;  // if system_ was built there
  System system_;
};

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/bundle_solver.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "colmap_lazyloc/math/cholesky3.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/query_prior_residual.h"
#include "colmap_lazyloc/refinement/rig_tolerance.h"

namespace lazyloc {
namespace {

// Minimum damping, relative to each diagonal element: unobservable directions get a large but finite variance.
constexpr double kRegularization = 1e-12;
// Initial damping: keeps the first step from overshooting along weakly observable directions.
constexpr double kFirstDamping = 1e-4;
constexpr double kMaxDamping = 1e8;

// Computes block -= a b^T column by column, because adjustment is 5 % faster so than with Eigen's product of such small
// matrices.
template <int kSize>
void SubtractProduct(const Eigen::Matrix<double, kSize, 3>& a, const Eigen::Matrix<double, kSize, 3>& b,
                     Eigen::Matrix<double, kSize, kSize>* block) {
  for (int col = 0; col < kSize; ++col) {
    block->col(col) -= a.col(0) * b(col, 0) + a.col(1) * b(col, 1) + a.col(2) * b(col, 2);
  }
}

std::vector<PosePriorResidual> EvaluatePriors(const BundleProblem& problem, const BundlePriors& priors,
                                              const BundleState& state) {
  std::vector<PosePriorResidual> residuals;
  for (const int frame : priors.frames) {
    residuals.push_back(EvaluatePosePrior(*problem.pose_priors[frame], state.frames[frame].frame_from_world));
  }
  return residuals;
}

RigToleranceResidual EvaluateFlex(const BundleFlex& flex, const BundleState& state) {
  const ParameterBlock& frame = state.frames[flex.frame];
  return EvaluateRigTolerance(*flex.given, state.frames[flex.calibration].frame_from_world,
                              frame.HasRigScale() ? std::optional(frame.log_factor) : std::nullopt,
                              state.frames[flex.cam].frame_from_world, frame.frame_from_world);
}

// Calls visit(frame, residual) for the priors of queries.
template <typename Visit>
void VisitQueryPriors(const BundleProblem& problem, const BundleState& state, const Visit& visit) {
  for (const BundleQueryPrior& image : problem.query_priors) {
    const ParameterBlock& frame = state.frames[image.frame];
    Rigid3d cam_from_frame = image.cam_from_frame;
    if (frame.HasRigScale()) cam_from_frame.translation *= std::exp(frame.log_factor);
    const auto& [position, gravity] = image.prior;
    if (position) visit(image.frame, EvaluatePositionPrior(*position, cam_from_frame, frame.frame_from_world));
    if (gravity) visit(image.frame, EvaluateGravityPrior(*gravity, cam_from_frame, frame.frame_from_world));
  }
}

}  // namespace

template <int kSize>
BundleSolver<kSize>::BundleSolver(const PosedImages& posed, const std::vector<Track>& tracks,
                                  const BundleAdjustmentOptions& options)
    : options_(options),
      loss_(options.loss_scale_sigma),
      problem_(posed, tracks),
      camera_system_(problem_.frames.size()),
      state_{problem_.frames, problem_.points} {
  for (const BundlePriors& priors : problem_.priors) camera_system_.AddPoint(priors.frames);
  std::vector<int> frames;
  for (const Range& range : problem_.free_range) {
    frames.clear();
    for (size_t i = range.begin; i < range.end; ++i) frames.push_back(problem_.free[i].frame);
    camera_system_.AddPoint(frames);
  }
  for (const BundleFlex& flex : problem_.flexes) camera_system_.AddPoint({flex.frame, flex.calibration, flex.cam});
  camera_system_.Finish();
}

template <int kSize>
StageSummary BundleSolver<kSize>::Minimize() {
  StageSummary summary{false, "a point lies behind a camera at the start", 0, 0};
  double damping = kFirstDamping;
  if (!Build(state_, damping)) return summary;
  summary = {true, "no convergence", 0, 0};
  BundleState next = state_;
  bool is_shortened = false;  // by damping: a short step then does not mean convergence
  double previous_sigma = 0;  // length of the step before
  for (; summary.iterations < options_.max_num_iterations && damping <= kMaxDamping; ++summary.iterations) {
    summary.cost = system_.cost;
    const double step_sigma = Step(&next);
    // Expects the next step to be shorter by the same factor, because near the minimum robust weights make steps shrink
    // at a constant rate.
    const double next_sigma = step_sigma * step_sigma / previous_sigma;
    previous_sigma = step_sigma;
    const bool is_short = step_sigma < options_.convergence_sigma || next_sigma < options_.convergence_sigma / 2;
    if (is_short && !is_shortened) {
      summary.message = "converged";
      const double cost = Cost(next);
      const bool is_lower = cost < summary.cost;
      if (is_lower) std::swap(state_, next);
      summary.cost = std::min(summary.cost, cost);
      if (damping > kRegularization) break;
      if (is_lower) before_last_step_ = std::move(next);
      return summary;  // with the last step's factor
    }
    const double next_damping = damping > kFirstDamping ? damping / 10 : kRegularization;
    is_shortened = !std::isfinite(step_sigma) || !Build(next, next_damping) || !(system_.cost < summary.cost);
    if (is_shortened) {
      damping = std::max(10 * damping, kFirstDamping);
      Build(state_, damping);
    } else {
      damping = next_damping;
      std::swap(state_, next);
    }
  }
  if (damping > kMaxDamping) summary.message = "no step lowers the cost";
  Build(state_, kRegularization);
  camera_system_.Factorize(system_.reduced);
  summary.cost = system_.cost;
  return summary;
}

template <int kSize>
std::vector<typename BundleSolver<kSize>::FrameMatrix> BundleSolver<kSize>::Covariances() const {
  if (camera_system_.HasFactor()) return camera_system_.DiagonalOfInverse();
  return std::vector<FrameMatrix>(state_.frames.size(), FrameMatrix::Identity() / kRegularization);
}

template <int kSize>
bool BundleSolver<kSize>::Build(const BundleState& state, double damping) {
  system_.cost = 0;
  camera_system_.SetZero(&system_.reduced);
  system_.rhs.setZero(kSize * static_cast<Eigen::Index>(state.frames.size()));
  system_.point_factors.resize(state.points.size());
  system_.eliminated.resize(problem_.free.size());
  std::vector<FrameMatrix> hessians(state.frames.size(), FrameMatrix::Zero());
  AddPriors(state, &hessians);
  for (const BundleFlex& flex : problem_.flexes) AddFlex(state, flex, &hessians);
  AddDepthMapPriors(state, &hessians);
  AddQueryPriors(state, &hessians);
  for (size_t track = 0; track < state.points.size(); ++track) {
    if (!AddTrack(state, track, damping, &hessians)) return false;
  }
  for (size_t frame = 0; frame < state.frames.size(); ++frame) {
    // Gives a factor that is not estimated a unit weight, which keeps it constant.
    if (kSize > 6 && state.frames[frame].kind == BlockKind::POSE) hessians[frame](kSize - 1, kSize - 1) = 1;
    if (state.frames[frame].kind == BlockKind::DEPTH_SCALE) hessians[frame].diagonal().tail(kSize - 1).setOnes();
    hessians[frame].diagonal() *= 1 + damping;
    camera_system_.Block(frame, frame, &system_.reduced) += hessians[frame];
  }
  return std::isfinite(system_.cost);
}

template <int kSize>
double BundleSolver<kSize>::Cost(const BundleState& state) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double cost = 0;
  for (const BundlePriors& priors : problem_.priors) {
    const std::vector<PosePriorResidual> residuals = EvaluatePriors(problem_, priors, state);
    for (size_t a = 0; a < residuals.size(); ++a) {
      for (size_t b = 0; b < residuals.size(); ++b) {
        cost += 0.5 * residuals[a].error.dot(priors.precision.Between(a, b).cwiseProduct(residuals[b].error));
      }
    }
  }
  for (const BundleFlex& flex : problem_.flexes) cost += 0.5 * EvaluateFlex(flex, state).error.squaredNorm();
  for (const BundleDepthMap& map : problem_.depth_maps) {
    cost += 0.5 * std::pow((state.frames[map.frame].log_factor - map.log_scale) / map.stddev, 2);
  }
  VisitQueryPriors(problem_, state,
                   [&](int, const QueryPriorResidual& prior) { cost += 0.5 * prior.error.squaredNorm(); });
  BundleError error;
  DepthError depth_error;
  for (size_t track = 0; track < state.points.size(); ++track) {
    const auto [fixed, free] = std::tie(problem_.fixed_range[track], problem_.free_range[track]);
    RobustLoss::Sum loss(loss_);
    for (size_t i = fixed.begin; i < fixed.end; ++i) {
      if (!error.Evaluate(problem_.fixed[i], state.points[track])) return kInfinity;
      loss.Add(error.error.squaredNorm());
    }
    for (size_t i = free.begin; i < free.end; ++i) {
      if (problem_.free[i].depth >= 0) {
        if (!Evaluate(state, problem_.free[i], track, &depth_error)) return kInfinity;
        loss.Add(depth_error.error * depth_error.error);
        continue;
      }
      const ParameterBlock& frame = state.frames[problem_.free[i].frame];
      if (!error.Evaluate(problem_.free[i], frame, state.points[track])) return kInfinity;
      loss.Add(error.error.squaredNorm());
    }
    cost += loss.Value();
  }
  return cost;
}

template <int kSize>
void BundleSolver<kSize>::AddPriors(const BundleState& state, std::vector<FrameMatrix>* frame_hessians) {
  for (const BundlePriors& priors : problem_.priors) {
    const std::vector<PosePriorResidual> residuals = EvaluatePriors(problem_, priors, state);
    for (size_t a = 0; a < residuals.size(); ++a) {
      const int frame = priors.frames[a];
      Eigen::Matrix<double, 6, 1> weighted = Eigen::Matrix<double, 6, 1>::Zero();
      for (size_t b = 0; b < residuals.size(); ++b) {
        weighted += priors.precision.Between(a, b).cwiseProduct(residuals[b].error);
      }
      system_.cost += 0.5 * residuals[a].error.dot(weighted);
      system_.rhs.template segment<6>(kSize * frame) -= residuals[a].jacobian.transpose() * weighted;
      for (size_t b = 0; b <= a; ++b) {
        FrameMatrix& block =
            a == b ? (*frame_hessians)[frame] : camera_system_.Block(frame, priors.frames[b], &system_.reduced);
        block.template topLeftCorner<6, 6>() +=
            residuals[a].jacobian.transpose() * priors.precision.Between(a, b).asDiagonal() * residuals[b].jacobian;
      }
    }
  }
}

template <int kSize>
void BundleSolver<kSize>::AddFlex(const BundleState& state, const BundleFlex& flex,
                                  std::vector<FrameMatrix>* frame_hessians) {
  const RigToleranceResidual residual = EvaluateFlex(flex, state);
  system_.cost += 0.5 * residual.error.squaredNorm();
  const std::array<std::pair<int, const Eigen::Matrix<double, 6, 7>*>, 3> parts = {
      {{flex.frame, &residual.by_frame}, {flex.calibration, &residual.by_calibration}, {flex.cam, &residual.by_cam}}};
  for (size_t a = 0; a < parts.size(); ++a) {
    const auto& [frame_a, all_by_a] = parts[a];
    const auto by_a = all_by_a->template leftCols<kSize>();
    system_.rhs.template segment<kSize>(kSize * frame_a) -= by_a.transpose() * residual.error;
    (*frame_hessians)[frame_a] += by_a.transpose() * by_a;
    for (size_t b = 0; b < a; ++b) {
      camera_system_.Block(frame_a, parts[b].first, &system_.reduced) +=
          by_a.transpose() * parts[b].second->template leftCols<kSize>();
    }
  }
}

template <int kSize>
void BundleSolver<kSize>::AddQueryPriors(const BundleState& state, std::vector<FrameMatrix>* frame_hessians) {
  VisitQueryPriors(problem_, state, [&](int frame, const QueryPriorResidual& prior) {
    Eigen::Matrix<double, 3, kSize> jacobian = prior.jacobian.template leftCols<kSize>();
    // Keeps a focal length apart, because only a rig's scale moves the projection centre.
    if (kSize > 6 && !state.frames[frame].HasRigScale()) jacobian.col(kSize - 1).setZero();
    system_.cost += 0.5 * prior.error.squaredNorm();
    system_.rhs.template segment<kSize>(kSize * frame) -= jacobian.transpose() * prior.error;
    (*frame_hessians)[frame] += jacobian.transpose() * jacobian;
  });
}

template <int kSize>
bool BundleSolver<kSize>::AddTrack(const BundleState& state, size_t track, double damping,
                                   std::vector<FrameMatrix>* frame_hessians) {
  const Eigen::Vector3d& point = state.points[track];
  const auto [fixed, free] = std::tie(problem_.fixed_range[track], problem_.free_range[track]);
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  RobustLoss::Sum loss(loss_);
  BundleError error;
  const auto weigh = [&] { error.Scale(std::sqrt(loss.Add(error.error.squaredNorm()))); };
  for (size_t i = fixed.begin; i < fixed.end; ++i) {
    if (!error.Evaluate(problem_.fixed[i], point)) return false;
    weigh();
    hessian += error.by_point.transpose().lazyProduct(error.by_point);
    gradient += error.by_point.transpose().lazyProduct(error.error);
  }
  for (size_t i = free.begin; i < free.end; ++i) {
    if (problem_.free[i].depth >= 0) {
      DepthError depth_error;
      if (!Evaluate(state, problem_.free[i], track, &depth_error)) return false;
      depth_error.Scale(std::sqrt(loss.Add(depth_error.error * depth_error.error)));
      hessian += depth_error.by_point_in_world.lazyProduct(depth_error.by_point_in_world.transpose());
      gradient += depth_error.error * depth_error.by_point_in_world;
      AddDepth(depth_error, i, track, frame_hessians);
      continue;
    }
    const ParameterBlock& frame = state.frames[problem_.free[i].frame];
    if (!error.Evaluate(problem_.free[i], frame, point)) return false;
    weigh();
    const Eigen::Matrix<double, 2, 3> by_point = error.ByPointInWorld(frame);
    const Eigen::Matrix<double, kSize, 2> by_frame = error.ByFrame<kSize>();
    hessian += by_point.transpose().lazyProduct(by_point);
    gradient += by_point.transpose().lazyProduct(error.error);
    (*frame_hessians)[problem_.free[i].frame] += by_frame.lazyProduct(by_frame.transpose());
    system_.rhs.template segment<kSize>(kSize * problem_.free[i].frame) -= by_frame.lazyProduct(error.error);
    system_.eliminated[i] = by_frame.lazyProduct(by_point);
  }
  system_.cost += loss.Value();
  hessian.diagonal() *= 1 + damping;
  EliminatePoint(track, hessian, gradient);
  return true;
}

template <int kSize>
void BundleSolver<kSize>::EliminatePoint(size_t track, const Eigen::Matrix3d& hessian,
                                         const Eigen::Vector3d& gradient) {
  const Eigen::Matrix3d inverse = InverseCholeskyFactor(hessian);
  system_.point_factors[track] = {inverse, inverse.lazyProduct(gradient)};
  const Range& range = problem_.free_range[track];
  for (size_t a = range.begin; a < range.end; ++a) {
    system_.eliminated[a] = system_.eliminated[a].lazyProduct(inverse.transpose()).eval();
    system_.rhs.template segment<kSize>(kSize * problem_.free[a].frame) +=
        system_.eliminated[a].lazyProduct(system_.point_factors[track].gradient);
  }
  for (size_t a = range.begin; a < range.end; ++a) {
    // The frames of a track ascend.
    for (size_t b = range.begin; b <= a; ++b) {
      FrameMatrix& block = camera_system_.Block(problem_.free[a].frame, problem_.free[b].frame, &system_.reduced);
      SubtractProduct(system_.eliminated[a], system_.eliminated[b], &block);
      // Adds the other half of the diagonal block for two images of one frame.
      if (a == b || problem_.free[a].frame != problem_.free[b].frame) continue;
      SubtractProduct(system_.eliminated[b], system_.eliminated[a], &block);
    }
  }
}

template <int kSize>
double BundleSolver<kSize>::Step(BundleState* next) {
  if (!camera_system_.Factorize(system_.reduced)) return std::numeric_limits<double>::quiet_NaN();
  const Eigen::VectorXd step = camera_system_.Solve(system_.rhs);
  for (size_t frame = 0; frame < state_.frames.size(); ++frame) {
    const FrameVector move = step.segment<kSize>(kSize * frame);
    if (state_.frames[frame].kind == BlockKind::DEPTH_SCALE) {
      next->frames[frame].log_factor = state_.frames[frame].log_factor + move(0);
      continue;
    }
    const Rigid3d& pose = state_.frames[frame].frame_from_world;
    next->frames[frame].MoveTo({(ExpSO3(move.template head<3>()) * pose.rotation).normalized(),
                                pose.translation + move.template segment<3>(3)});
    if (kSize > 6) next->frames[frame].log_factor = state_.frames[frame].log_factor + move(kSize - 1);
  }
  for (size_t track = 0; track < state_.points.size(); ++track) {
    Eigen::Vector3d step_in_factor = -system_.point_factors[track].gradient;
    for (size_t i = problem_.free_range[track].begin; i < problem_.free_range[track].end; ++i) {
      step_in_factor -=
          system_.eliminated[i].transpose().lazyProduct(step.segment<kSize>(kSize * problem_.free[i].frame));
    }
    next->points[track] =
        state_.points[track] + system_.point_factors[track].inverse.transpose().lazyProduct(step_in_factor);
  }
  return std::sqrt(std::max(step.dot(system_.rhs), 0.0) / static_cast<double>(state_.frames.size()));
}

template class BundleSolver<6>;
template class BundleSolver<7>;

}  // namespace lazyloc

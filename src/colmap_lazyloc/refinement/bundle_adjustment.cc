#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

using Matrix6x3d = Eigen::Matrix<double, 6, 3>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// What the solver changes.
struct State {
  std::vector<Rigid3d> poses;           // of the free views
  std::vector<Eigen::Vector3d> points;  // of the tracks
};

// A point's image in a free view.
struct FreeObservation {
  int pose;
  LinearProjection projection;  // of the point in the camera's frame
};

// One track, flat: ranges of the observation arrays.
struct Range {
  size_t begin = 0, end = 0;
};

// The normal equations around a state: poses and points coupled by one 6x3 block per free observation.
struct Linearization {
  double cost = 0;
  std::vector<Matrix6d> pose_hessians;
  std::vector<Vector6d> pose_gradients;
  std::vector<Eigen::Matrix3d> point_hessians;
  std::vector<Eigen::Vector3d> point_gradients;
  std::vector<Matrix6x3d> couplings;
};

class BundleSolver {
 public:
  BundleSolver(const BundleAdjustmentOptions& options, const std::vector<View>& views, const std::vector<Track>& tracks)
      : options_(options), squared_scale_(options.loss_scale_sigma * options.loss_scale_sigma) {
    std::vector<int> pose_of_view(views.size(), -1);
    for (size_t view = 0; view < views.size(); ++view) {
      if (views[view].is_fixed) continue;
      pose_of_view[view] = static_cast<int>(state_.poses.size());
      state_.poses.push_back(views[view].cam_from_world);
    }
    for (const Track& track : tracks) {
      const size_t fixed_begin = fixed_.size(), free_begin = free_.size();
      for (const TrackObservation& element : track.observations) {
        const View& view = views[element.view];
        const double residual_from_px = 1 / (track.noise_ratio * view.noise_px);
        if (view.is_fixed) {
          fixed_.push_back(ProjectionInWorld(element.observation, view.cam_from_world).Scaled(residual_from_px));
        } else {
          free_.push_back({pose_of_view[element.view], ProjectionInCam(element.observation).Scaled(residual_from_px)});
        }
      }
      fixed_range_.push_back({fixed_begin, fixed_.size()});
      free_range_.push_back({free_begin, free_.size()});
      state_.points.push_back(track.point_in_world);
    }
  }

  StageSummary Minimize() {
    StageSummary summary;
    Linearization current = Linearize(state_), trial;
    if (!std::isfinite(current.cost)) return {false, "a point lies behind a camera at the start", 0, current.cost};
    summary.message = "no convergence";
    double damping = 1e-4;
    for (; summary.iterations < options_.max_num_iterations; ++summary.iterations) {
      State next;
      if (Step(current, damping, &next)) Linearize(next, &trial);
      if (next.poses.empty() || !(trial.cost < current.cost)) {
        damping *= 10;
        if (damping > 1e8) {
          summary.message = "no step lowers the cost";
          break;
        }
        continue;
      }
      const double relative_decrease = (current.cost - trial.cost) / current.cost;
      std::swap(state_, next);
      std::swap(current, trial);
      damping = std::max(damping / 10, 1e-12);
      if (relative_decrease < options_.function_tolerance) {
        summary.message = "converged";
        break;
      }
    }
    summary.success = true;
    summary.cost = current.cost;
    return summary;
  }

  const State& Solution() const { return state_; }

 private:
  // Adds one observation's weighted terms; returns false behind the camera.
  bool AddCost(const Eigen::Vector2d& error, double* weight, Linearization* linearization) const {
    const double squared_error = error.squaredNorm();
    linearization->cost += 0.5 * squared_scale_ * std::log1p(squared_error / squared_scale_);
    *weight = CauchyWeight(squared_error, options_.loss_scale_sigma);
    return std::isfinite(squared_error);
  }

  Linearization Linearize(const State& state) const {
    Linearization linearization;
    Linearize(state, &linearization);
    return linearization;
  }

  void Linearize(const State& state, Linearization* result) const {
    result->cost = 0;
    result->pose_hessians.assign(state.poses.size(), Matrix6d::Zero());
    result->pose_gradients.assign(state.poses.size(), Vector6d::Zero());
    result->point_hessians.resize(state.points.size());
    result->point_gradients.resize(state.points.size());
    result->couplings.resize(free_.size());
    std::vector<Eigen::Matrix3d> rotations;
    for (const Rigid3d& pose : state.poses) rotations.push_back(pose.rotation.toRotationMatrix());
    for (size_t track = 0; track < state.points.size(); ++track) {
      if (!LinearizeTrack(state, rotations, track, result)) {
        result->cost = std::numeric_limits<double>::infinity();
        return;
      }
    }
  }

  bool LinearizeTrack(const State& state, const std::vector<Eigen::Matrix3d>& rotations, size_t track,
                      Linearization* result) const {
    const Eigen::Vector3d& point = state.points[track];
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    Eigen::Matrix<double, 2, 3> jacobian;
    double weight;
    for (size_t i = fixed_range_[track].begin; i < fixed_range_[track].end; ++i) {
      if (fixed_[i].Depth(point) <= 0) return false;
      const Eigen::Vector2d error = fixed_[i].Error(point, &jacobian);
      if (!AddCost(error, &weight, result)) return false;
      hessian.noalias() += weight * jacobian.transpose() * jacobian;
      gradient.noalias() += weight * jacobian.transpose() * error;
    }
    for (size_t i = free_range_[track].begin; i < free_range_[track].end; ++i) {
      const int pose = free_[i].pose;
      const Eigen::Vector3d rotated = rotations[pose] * point;
      const Eigen::Vector3d point_in_cam = rotated + state.poses[pose].translation;
      if (free_[i].projection.Depth(point_in_cam) <= 0) return false;
      const Eigen::Vector2d error = free_[i].projection.Error(point_in_cam, &jacobian);
      if (!AddCost(error, &weight, result)) return false;
      const Eigen::Matrix<double, 2, 3> point_jacobian = jacobian * rotations[pose];
      Eigen::Matrix<double, 2, 6> pose_jacobian;
      pose_jacobian << -jacobian * Hat(rotated), jacobian;
      hessian.noalias() += weight * point_jacobian.transpose() * point_jacobian;
      gradient.noalias() += weight * point_jacobian.transpose() * error;
      result->pose_hessians[pose].noalias() += weight * pose_jacobian.transpose() * pose_jacobian;
      result->pose_gradients[pose].noalias() += weight * pose_jacobian.transpose() * error;
      result->couplings[i].noalias() = weight * pose_jacobian.transpose() * point_jacobian;
    }
    result->point_hessians[track] = hessian;
    result->point_gradients[track] = gradient;
    return true;
  }

  // Solves the damped normal equations; false where they are not positive definite.
  bool Step(const Linearization& at, double damping, State* next) const {
    const auto damped = [damping](const auto& hessian) {
      auto result = hessian.eval();
      result.diagonal() *= 1 + damping;
      return result;
    };
    const Eigen::Index size = 6 * static_cast<Eigen::Index>(state_.poses.size());
    Eigen::MatrixXd reduced = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd rhs = Eigen::VectorXd::Zero(size);
    for (size_t pose = 0; pose < state_.poses.size(); ++pose) {
      reduced.block<6, 6>(6 * pose, 6 * pose) = damped(at.pose_hessians[pose]);
      rhs.segment<6>(6 * pose) = -at.pose_gradients[pose];
    }
    std::vector<Eigen::Matrix3d> point_inverses(state_.points.size());
    for (size_t track = 0; track < state_.points.size(); ++track) {
      bool is_invertible = false;
      damped(at.point_hessians[track]).computeInverseWithCheck(point_inverses[track], is_invertible, 0.0);
      if (!is_invertible) return false;
      for (size_t a = free_range_[track].begin; a < free_range_[track].end; ++a) {
        const Matrix6x3d eliminated = at.couplings[a] * point_inverses[track];
        rhs.segment<6>(6 * free_[a].pose) += eliminated * at.point_gradients[track];
        for (size_t b = free_range_[track].begin; b < free_range_[track].end; ++b) {
          reduced.block<6, 6>(6 * free_[a].pose, 6 * free_[b].pose).noalias() -=
              eliminated * at.couplings[b].transpose();
        }
      }
    }
    const Eigen::LDLT<Eigen::MatrixXd> factor(reduced);
    if (factor.info() != Eigen::Success || !factor.isPositive()) return false;
    const Eigen::VectorXd pose_steps = factor.solve(rhs);
    if (!pose_steps.allFinite()) return false;
    Move(at, pose_steps, point_inverses, next);
    return true;
  }

  void Move(const Linearization& at, const Eigen::VectorXd& pose_steps,
            const std::vector<Eigen::Matrix3d>& point_inverses, State* next) const {
    *next = state_;
    for (size_t pose = 0; pose < state_.poses.size(); ++pose) {
      Rigid3d& moved = next->poses[pose];
      moved.rotation = (ExpSO3(pose_steps.segment<3>(6 * pose)) * moved.rotation).normalized();
      moved.translation += pose_steps.segment<3>(6 * pose + 3);
    }
    for (size_t track = 0; track < state_.points.size(); ++track) {
      Eigen::Vector3d rhs = -at.point_gradients[track];
      for (size_t i = free_range_[track].begin; i < free_range_[track].end; ++i) {
        rhs.noalias() -= at.couplings[i].transpose() * pose_steps.segment<6>(6 * free_[i].pose);
      }
      next->points[track].noalias() += point_inverses[track] * rhs;
    }
  }

  const BundleAdjustmentOptions& options_;
  const double squared_scale_;
  State state_;
  std::vector<LinearProjection> fixed_;
  std::vector<FreeObservation> free_;
  std::vector<Range> fixed_range_, free_range_;  // per track
};

}  // namespace

bool BundleAdjustmentOptions::Check(std::string* error) const {
  OPTION_GT(loss_scale_sigma, 0);
  OPTION_GE(max_num_iterations, 1);
  OPTION_GE(function_tolerance, 0);
  return true;
}

StageSummary AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views,
                          std::vector<Track>* tracks) {
  BundleSolver solver(options, *views, *tracks);
  const StageSummary summary = solver.Minimize();
  size_t pose = 0;
  for (View& view : *views) {
    if (!view.is_fixed) view.cam_from_world = solver.Solution().poses[pose++];
  }
  for (size_t track = 0; track < tracks->size(); ++track) {
    (*tracks)[track].point_in_world = solver.Solution().points[track];
  }
  return summary;
}

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// What is known of a pose is what its observations leave: this part of each diagonal element keeps motions that nothing
// shows from an infinite variance.
constexpr double kRegularization = 1e-12;

// A view that the solver moves: six parameters, and a seventh where any focal length is sought.
struct Camera {
  Rigid3d cam_from_world;
  double log_focal_factor = 0;
};

// What the solver changes.
struct State {
  std::vector<Camera> cameras;
  std::vector<Eigen::Vector3d> points;  // of the tracks
};

// A point's image in a camera that moves.
struct FreeObservation {
  int camera;
  LinearProjection projection;  // of the point in the camera's frame
  Eigen::Vector2d residual_from_log_focal;
};

// One track, flat: ranges of the observation arrays.
struct Range {
  size_t begin = 0, end = 0;
};

// kSize: parameters of a camera.
template <int kSize>
class BundleSolver {
  using CameraVector = Eigen::Matrix<double, kSize, 1>;
  using CameraMatrix = Eigen::Matrix<double, kSize, kSize>;
  using Coupling = Eigen::Matrix<double, kSize, 3>;

  // The normal equations around a state: cameras and points coupled by one block per free observation.
  struct Linearization {
    double cost = 0;
    std::vector<CameraMatrix> camera_hessians;
    std::vector<CameraVector> camera_gradients;
    std::vector<Eigen::Matrix3d> point_hessians;
    std::vector<Eigen::Vector3d> point_gradients;
    std::vector<Coupling> couplings;
  };

 public:
  BundleSolver(const BundleAdjustmentOptions& options, const std::vector<View>& views, const std::vector<Track>& tracks)
      : options_(options), squared_scale_(options.loss_scale_sigma * options.loss_scale_sigma) {
    std::vector<int> camera_of_view(views.size(), -1);
    for (size_t view = 0; view < views.size(); ++view) {
      if (IsConstant(views[view])) continue;
      camera_of_view[view] = static_cast<int>(views_.size());
      views_.push_back(&views[view]);
      state_.cameras.push_back({views[view].cam_from_world, views[view].log_focal_factor.value_or(0)});
    }
    for (const Track& track : tracks) {
      const size_t fixed_begin = fixed_.size(), free_begin = free_.size();
      for (const TrackObservation& element : track.observations) {
        const View& view = views[element.view];
        const double residual_from_px = 1 / (track.noise_ratio * view.noise_px);
        if (IsConstant(view)) {
          fixed_.push_back(ProjectionInWorld(element.observation, view.cam_from_world).Scaled(residual_from_px));
        } else {
          free_.push_back({camera_of_view[element.view], ProjectionInCam(element.observation).Scaled(residual_from_px),
                           residual_from_px * element.observation.px_from_log_focal});
        }
      }
      fixed_range_.push_back({fixed_begin, fixed_.size()});
      free_range_.push_back({free_begin, free_.size()});
      state_.points.push_back(track.point_in_world);
    }
  }

  StageSummary Minimize() {
    StageSummary summary;
    Linearize(state_, &current_);
    if (!std::isfinite(current_.cost)) return {false, "a point lies behind a camera at the start", 0, current_.cost};
    summary.message = "no convergence";
    Linearization trial;
    State next;
    double damping = 1e-4;
    for (; summary.iterations < options_.max_num_iterations; ++summary.iterations) {
      const bool has_step = Step(damping, &next);
      if (has_step) Linearize(next, &trial);
      if (!has_step || !(trial.cost < current_.cost)) {
        damping *= 10;
        if (damping > 1e8) {
          summary.message = "no step lowers the cost";
          break;
        }
        continue;
      }
      const double relative_decrease = (current_.cost - trial.cost) / current_.cost;
      std::swap(state_, next);
      std::swap(current_, trial);
      damping = std::max(damping / 10, 1e-12);
      if (relative_decrease < options_.function_tolerance) {
        summary.message = "converged";
        break;
      }
    }
    summary.success = true;
    summary.cost = current_.cost;
    return summary;
  }

  const State& Solution() const { return state_; }

  // Of each camera's pose.
  std::vector<Eigen::Matrix<double, 6, 6>> Covariances() {
    std::vector<Eigen::Matrix<double, 6, 6>> covariances;
    Eigen::MatrixXd inverse;
    if (Reduce(kRegularization)) {
      inverse = factor_.solve(Eigen::MatrixXd::Identity(reduced_.rows(), reduced_.cols()));
    } else {
      inverse = Eigen::MatrixXd::Identity(reduced_.rows(), reduced_.cols()) / kRegularization;
    }
    for (size_t camera = 0; camera < state_.cameras.size(); ++camera) {
      covariances.push_back(inverse.template block<6, 6>(kSize * camera, kSize * camera));
    }
    return covariances;
  }

 private:
  void Linearize(const State& state, Linearization* result) const {
    result->cost = 0;
    result->camera_hessians.assign(state.cameras.size(), CameraMatrix::Zero());
    result->camera_gradients.assign(state.cameras.size(), CameraVector::Zero());
    result->point_hessians.resize(state.points.size());
    result->point_gradients.resize(state.points.size());
    result->couplings.resize(free_.size());
    std::vector<Eigen::Matrix3d> rotations;
    for (size_t camera = 0; camera < state.cameras.size(); ++camera) {
      rotations.push_back(state.cameras[camera].cam_from_world.rotation.toRotationMatrix());
      LinearizeKnowledge(state.cameras[camera].cam_from_world, camera, result);
    }
    for (size_t track = 0; track < state.points.size(); ++track) {
      if (!LinearizeTrack(state, rotations, track, result)) {
        result->cost = std::numeric_limits<double>::infinity();
        return;
      }
    }
  }

  // The prior of a pose; and a focal length that is not sought stays.
  void LinearizeKnowledge(const Rigid3d& cam_from_world, size_t camera, Linearization* result) const {
    if (views_[camera]->prior) {
      const PosePriorResidual residual = EvaluatePosePrior(*views_[camera]->prior, cam_from_world);
      result->cost += 0.5 * residual.error.squaredNorm();
      result->camera_hessians[camera].template topLeftCorner<6, 6>() =
          residual.jacobian.transpose() * residual.jacobian;
      result->camera_gradients[camera].template head<6>() = residual.jacobian.transpose() * residual.error;
    }
    if (kSize > 6 && !views_[camera]->log_focal_factor) result->camera_hessians[camera](kSize - 1, kSize - 1) = 1;
  }

  // Adds one observation's cost and returns its weight; not finite behind the camera.
  double AddCost(const Eigen::Vector2d& error, Linearization* result) const {
    const double squared_error = error.squaredNorm();
    result->cost += 0.5 * squared_scale_ * std::log1p(squared_error / squared_scale_);
    return CauchyWeight(squared_error, options_.loss_scale_sigma);
  }

  bool LinearizeTrack(const State& state, const std::vector<Eigen::Matrix3d>& rotations, size_t track,
                      Linearization* result) const {
    const Eigen::Vector3d& point = state.points[track];
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    Eigen::Matrix<double, 2, 3> jacobian;
    for (size_t i = fixed_range_[track].begin; i < fixed_range_[track].end; ++i) {
      if (!(fixed_[i].Depth(point) > 0)) return false;
      const Eigen::Vector2d error = fixed_[i].Error(point, &jacobian);
      const double weight = AddCost(error, result);
      hessian.noalias() += weight * jacobian.transpose() * jacobian;
      gradient.noalias() += weight * jacobian.transpose() * error;
    }
    for (size_t i = free_range_[track].begin; i < free_range_[track].end; ++i) {
      const int camera = free_[i].camera;
      const Eigen::Vector3d rotated = rotations[camera] * point;
      const Eigen::Vector3d point_in_cam = rotated + state.cameras[camera].cam_from_world.translation;
      if (!(free_[i].projection.Depth(point_in_cam) > 0)) return false;
      Eigen::Vector2d error = free_[i].projection.Error(point_in_cam, &jacobian);
      error += state.cameras[camera].log_focal_factor * free_[i].residual_from_log_focal;
      const double weight = AddCost(error, result);
      const Eigen::Matrix<double, 2, 3> point_jacobian = jacobian * rotations[camera];
      Eigen::Matrix<double, 2, kSize> camera_jacobian;
      camera_jacobian.template leftCols<3>().noalias() = -jacobian * Hat(rotated);
      camera_jacobian.template middleCols<3>(3) = jacobian;
      if (kSize > 6) camera_jacobian.col(kSize - 1) = free_[i].residual_from_log_focal;
      const Eigen::Matrix<double, kSize, 2> weighted = weight * camera_jacobian.transpose();
      hessian.noalias() += weight * point_jacobian.transpose() * point_jacobian;
      gradient.noalias() += weight * point_jacobian.transpose() * error;
      result->camera_hessians[camera].noalias() += weighted * camera_jacobian;
      result->camera_gradients[camera].noalias() += weighted * error;
      result->couplings[i].noalias() = weighted * point_jacobian;
    }
    result->point_hessians[track] = hessian;
    result->point_gradients[track] = gradient;
    return true;
  }

  // Eliminates the points from the damped normal equations (lower triangle) and factorises what is left; false where it is
  // not positive definite.
  bool Reduce(double damping) {
    const Eigen::Index size = kSize * static_cast<Eigen::Index>(state_.cameras.size());
    reduced_.setZero(size, size);
    rhs_.setZero(size);
    for (size_t camera = 0; camera < state_.cameras.size(); ++camera) {
      CameraMatrix hessian = current_.camera_hessians[camera];
      hessian.diagonal() *= 1 + damping;
      reduced_.template block<kSize, kSize>(kSize * camera, kSize * camera) = hessian;
      rhs_.template segment<kSize>(kSize * camera) = -current_.camera_gradients[camera];
    }
    point_factors_.resize(state_.points.size());
    eliminated_.resize(free_.size());
    for (size_t track = 0; track < state_.points.size(); ++track) {
      Eigen::Matrix3d hessian = current_.point_hessians[track];
      hessian.diagonal() *= 1 + damping;
      point_factors_[track].compute(hessian);
      if (point_factors_[track].info() != Eigen::Success) return false;
      EliminatePoint(track);
    }
    factor_.compute(reduced_);
    return factor_.info() == Eigen::Success;
  }

  void EliminatePoint(size_t track) {
    const auto triangle = point_factors_[track].matrixL();
    const Eigen::Vector3d gradient = triangle.solve(current_.point_gradients[track]);
    for (size_t a = free_range_[track].begin; a < free_range_[track].end; ++a) {
      eliminated_[a] = triangle.solve(current_.couplings[a].transpose());
      rhs_.template segment<kSize>(kSize * free_[a].camera).noalias() += eliminated_[a].transpose() * gradient;
      // Cameras of a track ascend.
      for (size_t b = free_range_[track].begin; b <= a; ++b) {
        reduced_.template block<kSize, kSize>(kSize * free_[a].camera, kSize * free_[b].camera).noalias() -=
            eliminated_[a].transpose() * eliminated_[b];
      }
    }
  }

  bool Step(double damping, State* next) {
    if (!Reduce(damping)) return false;
    const Eigen::VectorXd step = factor_.solve(rhs_);
    if (!step.allFinite()) return false;
    *next = state_;
    for (size_t camera = 0; camera < state_.cameras.size(); ++camera) {
      Camera& moved = next->cameras[camera];
      const CameraVector move = step.segment<kSize>(kSize * camera);
      moved.cam_from_world.rotation = (ExpSO3(move.template head<3>()) * moved.cam_from_world.rotation).normalized();
      moved.cam_from_world.translation += move.template segment<3>(3);
      if (kSize > 6) moved.log_focal_factor += move(kSize - 1);
    }
    for (size_t track = 0; track < state_.points.size(); ++track) {
      Eigen::Vector3d rhs = -current_.point_gradients[track];
      for (size_t i = free_range_[track].begin; i < free_range_[track].end; ++i) {
        rhs.noalias() -= current_.couplings[i].transpose() * step.segment<kSize>(kSize * free_[i].camera);
      }
      next->points[track] += point_factors_[track].solve(rhs);
    }
    return true;
  }

  const BundleAdjustmentOptions& options_;
  const double squared_scale_;
  std::vector<const View*> views_;  // of the cameras
  std::vector<LinearProjection> fixed_;
  std::vector<FreeObservation> free_;
  std::vector<Range> fixed_range_, free_range_;  // per track
  State state_;
  Linearization current_;  // around state_
  Eigen::MatrixXd reduced_;
  Eigen::VectorXd rhs_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
  std::vector<Eigen::LLT<Eigen::Matrix3d>> point_factors_;
  std::vector<Eigen::Matrix<double, 3, kSize>> eliminated_;  // per free observation
};

template <int kSize>
BundleAdjustmentResult Adjust(const BundleAdjustmentOptions& options, std::vector<View>* views,
                              std::vector<Track>* tracks) {
  BundleSolver<kSize> solver(options, *views, *tracks);
  BundleAdjustmentResult result;
  result.summary = solver.Minimize();
  result.pose_covariances.assign(views->size(), Eigen::Matrix<double, 6, 6>::Zero());
  if (!result.summary.success) return result;
  const std::vector<Eigen::Matrix<double, 6, 6>> covariances = solver.Covariances();
  size_t camera = 0;
  for (size_t view = 0; view < views->size(); ++view) {
    if (IsConstant((*views)[view])) continue;
    (*views)[view].cam_from_world = solver.Solution().cameras[camera].cam_from_world;
    if ((*views)[view].log_focal_factor) {
      (*views)[view].log_focal_factor = solver.Solution().cameras[camera].log_focal_factor;
    }
    result.pose_covariances[view] = covariances[camera++];
  }
  for (size_t track = 0; track < tracks->size(); ++track) {
    (*tracks)[track].point_in_world = solver.Solution().points[track];
  }
  return result;
}

}  // namespace

bool BundleAdjustmentOptions::Check(std::string* error) const {
  OPTION_GT(loss_scale_sigma, 0);
  OPTION_GE(max_num_iterations, 1);
  OPTION_GE(function_tolerance, 0);
  return true;
}

BundleAdjustmentResult AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views,
                                    std::vector<Track>* tracks) {
  const bool seeks_focal_length =
      std::any_of(views->begin(), views->end(), [](const View& view) { return view.log_focal_factor.has_value(); });
  return seeks_focal_length ? Adjust<7>(options, views, tracks) : Adjust<6>(options, views, tracks);
}

}  // namespace lazyloc

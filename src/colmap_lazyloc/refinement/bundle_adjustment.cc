#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <Eigen/Geometry>

#include "colmap_lazyloc/math/cholesky3.h"
#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_problem.h"
#include "colmap_lazyloc/refinement/camera_system.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/refinement/prior_fit.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// The least damping: this part of each diagonal element keeps motions that nothing shows from an infinite variance.
constexpr double kRegularization = 1e-12;

// What the solver changes.
struct State {
  std::vector<BundleCamera> cameras;
  std::vector<Eigen::Vector3d> points;  // of the tracks
};

// kSize: parameters of a camera.
template <int kSize>
class BundleSolver {
  using CameraVector = Eigen::Matrix<double, kSize, 1>;
  using CameraMatrix = Eigen::Matrix<double, kSize, kSize>;
  using Coupling = Eigen::Matrix<double, kSize, 3>;

  // Of a point's damped Hessian H = L L^T and gradient g.
  struct PointFactor {
    Eigen::Matrix3d inverse;   // L^-1
    Eigen::Vector3d gradient;  // L^-1 g
  };

  // The damped normal equations around a state, with the points eliminated, and what brings the points back.
  struct System {
    double cost = 0;
    Eigen::MatrixXd reduced;  // as CameraSystem has it
    Eigen::VectorXd rhs;
    std::vector<PointFactor> point_factors;
    std::vector<Coupling> eliminated;  // per free observation: its coupling times the inverse factor, transposed
  };

 public:
  BundleSolver(const BundleAdjustmentOptions& options, const std::vector<View>& views, const std::vector<Track>& tracks)
      : options_(options),
        squared_scale_(options.loss_scale_sigma * options.loss_scale_sigma),
        problem_(views, tracks),
        camera_system_(problem_.cameras.size()),
        state_{problem_.cameras, problem_.points} {
    std::vector<int> cameras;
    for (const Range& range : problem_.free_range) {
      cameras.clear();
      for (size_t i = range.begin; i < range.end; ++i) cameras.push_back(problem_.free[i].camera);
      camera_system_.AddPoint(cameras);
    }
    camera_system_.Finish();
  }

  StageSummary Minimize() {
    StageSummary summary;
    double damping = 1e-4;
    bool is_shortened = false;  // by damping: then a short step does not mean convergence
    System trial;
    State next = state_;
    if (!Build(state_, damping, &system_)) return {false, "a point lies behind a camera at the start", 0, system_.cost};
    summary.message = "no convergence";
    for (; summary.iterations < options_.max_num_iterations; ++summary.iterations) {
      const double step_sigma = Step(system_, &next);
      const bool is_last = step_sigma < options_.convergence_sigma && !is_shortened;
      const double next_damping = is_last ? kRegularization : std::max(damping / 10, kRegularization);
      if (!std::isfinite(step_sigma) || !Build(next, next_damping, &trial) || !(trial.cost < system_.cost)) {
        damping *= 10;
        is_shortened = true;
        if (damping > 1e8) {
          summary.message = "no step lowers the cost";
          break;
        }
        Build(state_, damping, &system_);
        continue;
      }
      damping = next_damping;
      is_shortened = false;
      std::swap(state_, next);
      std::swap(system_, trial);
      if (is_last) {
        summary.message = "converged";
        break;
      }
    }
    if (damping != kRegularization) Build(state_, kRegularization, &system_);
    summary.success = true;
    summary.cost = system_.cost;
    return summary;
  }

  const State& Solution() const { return state_; }
  int CameraOfView(size_t view) const { return problem_.camera_of_view[view]; }

  // Of each camera's parameters, at the minimum.
  std::vector<CameraMatrix> Covariances() {
    if (camera_system_.Factorize(system_.reduced)) return camera_system_.DiagonalOfInverse();
    return std::vector<CameraMatrix>(state_.cameras.size(), CameraMatrix::Identity() / kRegularization);
  }

  // After Covariances. prior_parts: per camera, empty without priors or where there are many cameras.
  PriorFit FitOfPriors(std::vector<Eigen::MatrixXd>* prior_parts) const {
    std::vector<PriorDeviation> deviations;
    for (size_t camera = 0; camera < state_.cameras.size(); ++camera) {
      if (!problem_.views[camera]->prior) continue;
      deviations.push_back({static_cast<int>(camera),
                            EvaluatePosePrior(*problem_.views[camera]->prior, state_.cameras[camera].cam_from_world)});
    }
    if (deviations.empty()) return {};
    const std::optional<Eigen::MatrixXd> inverse = camera_system_.Inverse();
    return inverse ? FitPriors(deviations, *inverse, kSize, prior_parts) : PriorFit();
  }

 private:
  // False where a point lies behind one of its cameras.
  bool Build(const State& state, double damping, System* system) const {
    system->cost = 0;
    camera_system_.SetZero(&system->reduced);
    system->rhs.setZero(kSize * static_cast<Eigen::Index>(state.cameras.size()));
    system->point_factors.resize(state.points.size());
    system->eliminated.resize(problem_.free.size());
    std::vector<CameraMatrix> hessians(state.cameras.size(), CameraMatrix::Zero());
    std::vector<Eigen::Matrix3d> rotations;
    for (size_t camera = 0; camera < state.cameras.size(); ++camera) {
      rotations.push_back(state.cameras[camera].cam_from_world.rotation.toRotationMatrix());
      AddKnowledge(state.cameras[camera].cam_from_world, camera, &hessians[camera], system);
    }
    for (size_t track = 0; track < state.points.size(); ++track) {
      if (!AddTrack(state, rotations, track, damping, &hessians, system)) return false;
    }
    for (size_t camera = 0; camera < state.cameras.size(); ++camera) {
      hessians[camera].diagonal() *= 1 + damping;
      camera_system_.Block(camera, camera, &system->reduced) += hessians[camera];
    }
    return std::isfinite(system->cost);
  }

  // The prior of a pose; and a factor that is not sought stays.
  void AddKnowledge(const Rigid3d& cam_from_world, size_t camera, CameraMatrix* hessian, System* system) const {
    if (problem_.views[camera]->prior) {
      const PosePriorResidual residual = EvaluatePosePrior(*problem_.views[camera]->prior, cam_from_world);
      system->cost += 0.5 * residual.error.squaredNorm();
      hessian->template topLeftCorner<6, 6>() += residual.jacobian.transpose() * residual.jacobian;
      system->rhs.template segment<6>(kSize * camera) -= residual.jacobian.transpose() * residual.error;
    }
    const bool seeks_factor = problem_.views[camera]->log_focal_factor || problem_.views[camera]->seeks_rig_scale;
    if (kSize > 6 && !seeks_factor) (*hessian)(kSize - 1, kSize - 1) = 1;
  }

  // One pass over a track: its errors' derivatives, and its point eliminated from them.
  bool AddTrack(const State& state, const std::vector<Eigen::Matrix3d>& rotations, size_t track, double damping,
                std::vector<CameraMatrix>* camera_hessians, System* system) const {
    const Eigen::Vector3d& point = state.points[track];
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    Eigen::Matrix<double, 2, 3> jacobian;
    double cost_factor = 1;  // the sum of logs as the log of a product
    const auto weigh = [&](const Eigen::Vector2d& error) {
      const double squared_error = error.squaredNorm();
      cost_factor *= 1 + squared_error / squared_scale_;
      return CauchyWeight(squared_error, options_.loss_scale_sigma);
    };
    for (size_t i = problem_.fixed_range[track].begin; i < problem_.fixed_range[track].end; ++i) {
      if (!(problem_.fixed[i].Depth(point) > 0)) return false;
      const Eigen::Vector2d error = problem_.fixed[i].Error(point, &jacobian);
      const Eigen::Matrix<double, 3, 2> weighted = weigh(error) * jacobian.transpose();
      hessian += weighted.lazyProduct(jacobian);
      gradient += weighted.lazyProduct(error);
    }
    for (size_t i = problem_.free_range[track].begin; i < problem_.free_range[track].end; ++i) {
      const BundleCamera& camera = state.cameras[problem_.free[i].camera];
      const Eigen::Matrix3d& rotation = rotations[problem_.free[i].camera];
      const Eigen::Vector3d rotated = rotation.lazyProduct(point);
      const Eigen::Vector3d point_in_cam = rotated + camera.cam_from_world.translation;
      const bool has_scale = kSize > 6 && problem_.views[problem_.free[i].camera]->seeks_rig_scale;
      const LinearProjection projection =
          has_scale ? problem_.free[i].projection.WithOffset(std::exp(camera.log_factor)) : problem_.free[i].projection;
      if (!(projection.Depth(point_in_cam) > 0)) return false;
      Eigen::Vector2d error = projection.Error(point_in_cam, &jacobian);
      Eigen::Vector2d residual_from_log_factor = problem_.free[i].residual_from_log_focal;
      if (has_scale) {
        residual_from_log_factor = projection.DerivativeByLogOffset(point_in_cam, error);
      } else {
        error += camera.log_factor * residual_from_log_factor;
      }
      const double weight = weigh(error);
      const Eigen::Matrix<double, 2, 3> point_jacobian = jacobian.lazyProduct(rotation);
      Eigen::Matrix<double, 2, kSize> camera_jacobian;
      // d(point_in_cam)/dw = -Hat(rotated): each row of the product is a cross product.
      camera_jacobian.row(0).template head<3>() = rotated.cross(jacobian.row(0).transpose()).transpose();
      camera_jacobian.row(1).template head<3>() = rotated.cross(jacobian.row(1).transpose()).transpose();
      camera_jacobian.template middleCols<3>(3) = jacobian;
      if (kSize > 6) camera_jacobian.col(kSize - 1) = residual_from_log_factor;
      const Eigen::Matrix<double, kSize, 2> weighted = weight * camera_jacobian.transpose();
      hessian += (weight * point_jacobian.transpose()).lazyProduct(point_jacobian);
      gradient += (weight * point_jacobian.transpose()).lazyProduct(error);
      (*camera_hessians)[problem_.free[i].camera] += weighted.lazyProduct(camera_jacobian);
      system->rhs.template segment<kSize>(kSize * problem_.free[i].camera) -= weighted.lazyProduct(error);
      system->eliminated[i] = weighted.lazyProduct(point_jacobian);
    }
    system->cost += 0.5 * squared_scale_ * std::log(cost_factor);
    hessian.diagonal() *= 1 + damping;
    EliminatePoint(track, hessian, gradient, system);
    return true;
  }

  // Schur complement of one point, by its Cholesky factor: what is subtracted is a square, so that it stays positive
  // definite however badly the point is determined. system->eliminated holds the couplings before.
  void EliminatePoint(size_t track, const Eigen::Matrix3d& hessian, const Eigen::Vector3d& gradient,
                      System* system) const {
    const Eigen::Matrix3d inverse = InverseCholeskyFactor(hessian);
    system->point_factors[track] = {inverse, inverse.lazyProduct(gradient)};
    for (size_t a = problem_.free_range[track].begin; a < problem_.free_range[track].end; ++a) {
      system->eliminated[a] = system->eliminated[a].lazyProduct(inverse.transpose()).eval();
      system->rhs.template segment<kSize>(kSize * problem_.free[a].camera) +=
          system->eliminated[a].lazyProduct(system->point_factors[track].gradient);
      // Cameras of a track ascend.
      for (size_t b = problem_.free_range[track].begin; b <= a; ++b) {
        camera_system_.Block(problem_.free[a].camera, problem_.free[b].camera, &system->reduced) -=
            system->eliminated[a].lazyProduct(system->eliminated[b].transpose());
        // Two images of one rig: the other half of the diagonal block.
        if (a == b || problem_.free[a].camera != problem_.free[b].camera) continue;
        camera_system_.Block(problem_.free[a].camera, problem_.free[a].camera, &system->reduced) -=
            system->eliminated[b].lazyProduct(system->eliminated[a].transpose());
      }
    }
  }

  // Returns the length of the cameras' step in standard deviations (Mahalanobis distance by the reduced system), root
  // mean square over the cameras; NaN where the system is not positive definite.
  double Step(const System& system, State* next) {
    if (!camera_system_.Factorize(system.reduced)) return std::numeric_limits<double>::quiet_NaN();
    const Eigen::VectorXd step = camera_system_.Solve(system.rhs);
    for (size_t camera = 0; camera < state_.cameras.size(); ++camera) {
      const CameraVector move = step.segment<kSize>(kSize * camera);
      const Rigid3d& pose = state_.cameras[camera].cam_from_world;
      next->cameras[camera].cam_from_world = {(ExpSO3(move.template head<3>()) * pose.rotation).normalized(),
                                              pose.translation + move.template segment<3>(3)};
      if (kSize > 6) next->cameras[camera].log_factor = state_.cameras[camera].log_factor + move(kSize - 1);
    }
    for (size_t track = 0; track < state_.points.size(); ++track) {
      Eigen::Vector3d step_in_factor = -system.point_factors[track].gradient;
      for (size_t i = problem_.free_range[track].begin; i < problem_.free_range[track].end; ++i) {
        step_in_factor -=
            system.eliminated[i].transpose().lazyProduct(step.segment<kSize>(kSize * problem_.free[i].camera));
      }
      next->points[track] =
          state_.points[track] + system.point_factors[track].inverse.transpose().lazyProduct(step_in_factor);
    }
    return std::sqrt(std::max(step.dot(system.rhs), 0.0) / static_cast<double>(state_.cameras.size()));
  }

  const BundleAdjustmentOptions& options_;
  const double squared_scale_;
  const BundleProblem problem_;
  CameraSystem<kSize> camera_system_;
  State state_;
  System system_;  // around the state
};

template <int kSize>
BundleAdjustmentResult Adjust(const BundleAdjustmentOptions& options, std::vector<View>* views,
                              std::vector<Track>* tracks) {
  BundleSolver<kSize> solver(options, *views, *tracks);
  BundleAdjustmentResult result;
  result.summary = solver.Minimize();
  result.pose_covariances.assign(views->size(), Eigen::Matrix<double, 6, 6>::Zero());
  result.prior_parts = result.pose_covariances;
  if (!result.summary.success) return result;
  const std::vector<Eigen::Matrix<double, kSize, kSize>> covariances = solver.Covariances();
  std::vector<Eigen::MatrixXd> prior_parts;
  result.prior_fit = solver.FitOfPriors(&prior_parts);
  for (size_t i = 0; i < views->size(); ++i) {
    View& view = (*views)[i];
    if (IsConstant(view)) continue;
    const int camera_index = solver.CameraOfView(i);
    const BundleCamera& camera = solver.Solution().cameras[camera_index];
    const bool seeks_scale = view.rig_link && (*views)[view.rig_link->reference].seeks_rig_scale;
    if (seeks_scale) view.rig_link->cam_from_reference.translation *= std::exp(camera.log_factor);
    if (!view.rig_link) view.cam_from_world = camera.cam_from_world;
    if (view.log_focal_factor) view.log_focal_factor = camera.log_factor;
    const auto of_view = [&](const Eigen::MatrixXd& of_camera) -> Eigen::Matrix<double, 6, 6> {
      if (view.rig_link) return LinkedCovariance(*view.rig_link, seeks_scale, of_camera);
      return of_camera.topLeftCorner<6, 6>();
    };
    result.pose_covariances[i] = of_view(covariances[camera_index]);
    if (!prior_parts.empty()) result.prior_parts[i] = of_view(prior_parts[camera_index]);
  }
  FollowReferences(views);
  for (size_t track = 0; track < tracks->size(); ++track) {
    (*tracks)[track].point_in_world = solver.Solution().points[track];
  }
  return result;
}

}  // namespace

bool BundleAdjustmentOptions::Check(std::string* error) const {
  OPTION_GT(loss_scale_sigma, 0);
  OPTION_GE(max_num_iterations, 1);
  OPTION_GE(convergence_sigma, 0);
  return true;
}

BundleAdjustmentResult AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views,
                                    std::vector<Track>* tracks) {
  const auto seeks_factor = [](const View& view) { return view.log_focal_factor || view.seeks_rig_scale; };
  return std::any_of(views->begin(), views->end(), seeks_factor) ? Adjust<7>(options, views, tracks)
                                                                 : Adjust<6>(options, views, tracks);
}

}  // namespace lazyloc

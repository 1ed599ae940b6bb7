#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

#include <Eigen/Geometry>

#include "colmap_lazyloc/math/block_product.h"
#include "colmap_lazyloc/math/cholesky3.h"
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
// Of the first step, which may start far from the minimum: it would go too far along motions that hardly show.
constexpr double kFirstDamping = 1e-4;
constexpr double kMaxDamping = 1e8;

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
    typename CameraSystem<kSize>::Blocks reduced;
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

  // A damped step, then Gauss-Newton as long as it lowers the cost; more damping where it does not.
  StageSummary Minimize() {
    StageSummary summary{false, "a point lies behind a camera at the start", 0, 0};
    double damping = kFirstDamping;
    if (!Build(state_, damping)) return summary;
    summary = {true, "no convergence", 0, 0};
    State next = state_;
    bool is_shortened = false;  // by damping: then a short step does not mean convergence
    for (; summary.iterations < options_.max_num_iterations && damping <= kMaxDamping; ++summary.iterations) {
      summary.cost = system_.cost;
      const double step_sigma = Step(&next);
      if (step_sigma < options_.convergence_sigma && !is_shortened) {
        summary.message = "converged";
        const double cost = Cost(next);
        if (cost < summary.cost) std::swap(state_, next);
        summary.cost = std::min(summary.cost, cost);
        if (damping == kRegularization) return summary;  // with the last step's factor
        break;
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

  const State& Solution() const { return state_; }
  int CameraOfView(size_t view) const { return problem_.camera_of_view[view]; }

  // Of each camera's parameters, at the minimum or a step before it that is as short as convergence means.
  std::vector<CameraMatrix> Covariances() {
    if (camera_system_.HasFactor()) return camera_system_.DiagonalOfInverse();
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
    if (deviations.empty() || !camera_system_.HasFactor()) return {};
    const std::optional<Eigen::MatrixXd> inverse = camera_system_.Inverse();
    return inverse ? FitPriors(deviations, *inverse, kSize, prior_parts) : PriorFit();
  }

 private:
  // The system around a state. False where a point lies behind one of its cameras.
  bool Build(const State& state, double damping) {
    system_.cost = 0;
    camera_system_.SetZero(&system_.reduced);
    system_.rhs.setZero(kSize * static_cast<Eigen::Index>(state.cameras.size()));
    system_.point_factors.resize(state.points.size());
    system_.eliminated.resize(problem_.free.size());
    std::vector<CameraMatrix> hessians(state.cameras.size(), CameraMatrix::Zero());
    for (size_t camera = 0; camera < state.cameras.size(); ++camera) {
      AddKnowledge(state.cameras[camera].cam_from_world, camera, &hessians[camera]);
    }
    for (size_t track = 0; track < state.points.size(); ++track) {
      if (!AddTrack(state, track, damping, &hessians)) return false;
    }
    for (size_t camera = 0; camera < state.cameras.size(); ++camera) {
      hessians[camera].diagonal() *= 1 + damping;
      camera_system_.Block(camera, camera, &system_.reduced) += hessians[camera];
    }
    return std::isfinite(system_.cost);
  }

  // Of a state, without its system; infinite where a point lies behind one of its cameras.
  double Cost(const State& state) const {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    double cost = 0;
    for (size_t camera = 0; camera < state.cameras.size(); ++camera) {
      const std::optional<PosePrior>& prior = problem_.views[camera]->prior;
      if (prior) cost += 0.5 * EvaluatePosePrior(*prior, state.cameras[camera].cam_from_world).error.squaredNorm();
    }
    BundleError error;
    for (size_t track = 0; track < state.points.size(); ++track) {
      const auto [fixed, free] = std::tie(problem_.fixed_range[track], problem_.free_range[track]);
      double cost_factor = 1;
      for (size_t i = fixed.begin; i < fixed.end; ++i) {
        if (!error.Evaluate(problem_.fixed[i], state.points[track])) return kInfinity;
        cost_factor *= CostFactor(error);
      }
      for (size_t i = free.begin; i < free.end; ++i) {
        const BundleCamera& camera = state.cameras[problem_.free[i].camera];
        if (!error.Evaluate(problem_.free[i], camera, state.points[track])) return kInfinity;
        cost_factor *= CostFactor(error);
      }
      cost += 0.5 * squared_scale_ * std::log(cost_factor);
    }
    return cost;
  }

  // The sum of logs is the log of a product. Its inverse is the robust weight.
  double CostFactor(const BundleError& error) const { return 1 + error.error.squaredNorm() / squared_scale_; }

  // The prior of a pose; and a factor that is not sought stays.
  void AddKnowledge(const Rigid3d& cam_from_world, size_t camera, CameraMatrix* hessian) {
    if (problem_.views[camera]->prior) {
      const PosePriorResidual residual = EvaluatePosePrior(*problem_.views[camera]->prior, cam_from_world);
      system_.cost += 0.5 * residual.error.squaredNorm();
      hessian->template topLeftCorner<6, 6>() += residual.jacobian.transpose() * residual.jacobian;
      system_.rhs.template segment<6>(kSize * camera) -= residual.jacobian.transpose() * residual.error;
    }
    const bool seeks_factor = problem_.views[camera]->log_focal_factor || problem_.views[camera]->seeks_rig_scale;
    if (kSize > 6 && !seeks_factor) (*hessian)(kSize - 1, kSize - 1) = 1;
  }

  // One pass over a track: its errors' derivatives, and its point eliminated from them.
  bool AddTrack(const State& state, size_t track, double damping, std::vector<CameraMatrix>* camera_hessians) {
    const Eigen::Vector3d& point = state.points[track];
    const auto [fixed, free] = std::tie(problem_.fixed_range[track], problem_.free_range[track]);
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    double cost_factor = 1;
    BundleError error;
    const auto weigh = [&] {
      const double factor = CostFactor(error);
      cost_factor *= factor;
      error.Scale(std::sqrt(1 / factor));
    };
    for (size_t i = fixed.begin; i < fixed.end; ++i) {
      if (!error.Evaluate(problem_.fixed[i], point)) return false;
      weigh();
      hessian += error.by_point.transpose().lazyProduct(error.by_point);
      gradient += error.by_point.transpose().lazyProduct(error.error);
    }
    for (size_t i = free.begin; i < free.end; ++i) {
      const BundleCamera& camera = state.cameras[problem_.free[i].camera];
      if (!error.Evaluate(problem_.free[i], camera, point)) return false;
      weigh();
      const Eigen::Matrix<double, 2, 3> by_point = error.by_point.lazyProduct(camera.rotation);
      Eigen::Matrix<double, kSize, 2> by_camera;  // transposed
      // d(point_in_cam)/dw = -Hat(rotated_point): each row of the product is a cross product.
      by_camera.col(0).template head<3>() = error.rotated_point.cross(error.by_point.row(0).transpose());
      by_camera.col(1).template head<3>() = error.rotated_point.cross(error.by_point.row(1).transpose());
      by_camera.template middleRows<3>(3) = error.by_point.transpose();
      if (kSize > 6) by_camera.row(kSize - 1) = error.by_log_factor.transpose();
      hessian += by_point.transpose().lazyProduct(by_point);
      gradient += by_point.transpose().lazyProduct(error.error);
      (*camera_hessians)[problem_.free[i].camera] += by_camera.lazyProduct(by_camera.transpose());
      system_.rhs.template segment<kSize>(kSize * problem_.free[i].camera) -= by_camera.lazyProduct(error.error);
      system_.eliminated[i] = by_camera.lazyProduct(by_point);
    }
    system_.cost += 0.5 * squared_scale_ * std::log(cost_factor);
    hessian.diagonal() *= 1 + damping;
    EliminatePoint(track, hessian, gradient);
    return true;
  }

  // Schur complement of one point, by its Cholesky factor: what is subtracted is a square, so that it stays positive
  // definite however badly the point is determined. system_.eliminated holds the couplings before.
  void EliminatePoint(size_t track, const Eigen::Matrix3d& hessian, const Eigen::Vector3d& gradient) {
    const Eigen::Matrix3d inverse = InverseCholeskyFactor(hessian);
    system_.point_factors[track] = {inverse, inverse.lazyProduct(gradient)};
    const Range& range = problem_.free_range[track];
    for (size_t a = range.begin; a < range.end; ++a) {
      system_.eliminated[a] = system_.eliminated[a].lazyProduct(inverse.transpose()).eval();
      system_.rhs.template segment<kSize>(kSize * problem_.free[a].camera) +=
          system_.eliminated[a].lazyProduct(system_.point_factors[track].gradient);
    }
    RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
      for (size_t a = range.begin; a < range.end; ++a) {
        // Cameras of a track ascend.
        for (size_t b = range.begin; b <= a; ++b) {
          CameraMatrix& block =
              camera_system_.Block(problem_.free[a].camera, problem_.free[b].camera, &system_.reduced);
          SubtractProduct(system_.eliminated[a], system_.eliminated[b], &block);
          // Two images of one rig: the other half of the diagonal block.
          if (a == b || problem_.free[a].camera != problem_.free[b].camera) continue;
          SubtractProduct(system_.eliminated[b], system_.eliminated[a], &block);
        }
      }
    });
  }

  // Returns the length of the cameras' step in standard deviations (Mahalanobis distance by the reduced system), root
  // mean square over the cameras; NaN where the system is not positive definite.
  double Step(State* next) {
    if (!camera_system_.Factorize(system_.reduced)) return std::numeric_limits<double>::quiet_NaN();
    const Eigen::VectorXd step = camera_system_.Solve(system_.rhs);
    for (size_t camera = 0; camera < state_.cameras.size(); ++camera) {
      const CameraVector move = step.segment<kSize>(kSize * camera);
      const Rigid3d& pose = state_.cameras[camera].cam_from_world;
      next->cameras[camera].MoveTo({(ExpSO3(move.template head<3>()) * pose.rotation).normalized(),
                                    pose.translation + move.template segment<3>(3)});
      if (kSize > 6) next->cameras[camera].log_factor = state_.cameras[camera].log_factor + move(kSize - 1);
    }
    for (size_t track = 0; track < state_.points.size(); ++track) {
      Eigen::Vector3d step_in_factor = -system_.point_factors[track].gradient;
      for (size_t i = problem_.free_range[track].begin; i < problem_.free_range[track].end; ++i) {
        step_in_factor -=
            system_.eliminated[i].transpose().lazyProduct(step.segment<kSize>(kSize * problem_.free[i].camera));
      }
      next->points[track] =
          state_.points[track] + system_.point_factors[track].inverse.transpose().lazyProduct(step_in_factor);
    }
    return std::sqrt(std::max(step.dot(system_.rhs), 0.0) / static_cast<double>(state_.cameras.size()));
  }

  const BundleAdjustmentOptions& options_;
  const double squared_scale_;
  const BundleProblem problem_;
  CameraSystem<kSize> camera_system_;
  State state_;
  System system_;
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
  if (options.fits_priors) result.prior_fit = solver.FitOfPriors(&prior_parts);
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

#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "colmap_lazyloc/refinement/bundle_solver.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool BundleAdjustmentOptions::Check(std::string* error) const {
  OPTION_GT(loss_scale_sigma, 0);
  OPTION_GE(max_num_iterations, 0);
  OPTION_GT(convergence_sigma, 0);
  return true;
}

namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Moves the frames, and the images that depend on the estimated factors, to the solution.
template <int kSize>
PosedImages MovedTo(const BundleSolver<kSize>& solver, PosedImages posed) {
  std::vector<double> log_factors(posed.frames.size(), 0);
  for (size_t i = 0; i < posed.frames.size(); ++i) {
    const int index = solver.Problem().index_of_frame[i];
    if (index < 0) continue;
    const ParameterBlock& solution = solver.Solution().frames[index];
    posed.frames[i].frame_from_world = solution.frame_from_world;
    log_factors[i] = solution.log_factor;
    if (posed.frames[i].has_free_scale) posed.frames[i].scale *= std::exp(solution.log_factor);
  }
  std::vector<double> calibration_scales(posed.calibrations.size(), 1);
  for (const Image& image : posed.images) {
    if (image.calibration < 0 || !posed.frames[image.frame].has_free_scale) continue;
    calibration_scales[image.calibration] = std::exp(log_factors[image.frame]);
  }
  for (size_t i = 0; i < posed.calibrations.size(); ++i) {
    Rigid3d& cam_from_frame = posed.calibrations[i].cam_from_frame;
    const int index = solver.Problem().index_of_calibration[i];
    if (index >= 0) cam_from_frame = solver.Solution().frames[index].frame_from_world;
    cam_from_frame.translation *= calibration_scales[i];
  }
  for (size_t i = 0; i < posed.images.size(); ++i) {
    Image& image = posed.images[i];
    const int index = solver.Problem().index_of_image[i];
    if (index != solver.Problem().index_of_frame[image.frame]) {
      image.cam_from_frame =
          solver.Solution().frames[index].frame_from_world * Inverse(posed.frames[image.frame].frame_from_world);
    } else if (posed.frames[image.frame].has_free_scale && !HasFrameAxes(image)) {
      image.cam_from_frame.translation *= std::exp(log_factors[image.frame]);
    }
    if (image.log_focal_factor) image.log_focal_factor = solver.Solution().frames[index].log_factor;
    const int depth_map = solver.Problem().index_of_depth_map[i];
    if (depth_map >= 0) image.depth_scale->log_scale = solver.Solution().frames[depth_map].log_factor;
  }
  return posed;
}

// Returns the covariance of an image by that of the parameters of its pose.
Matrix6d CovarianceOf(const PosedImages& posed, size_t image, const BundleProblem& problem,
                      const Eigen::MatrixXd& of_parameters) {
  const int frame = posed.images[image].frame;
  if (problem.index_of_image[image] != problem.index_of_frame[frame]) return of_parameters.topLeftCorner<6, 6>();
  return ImageCovariance(posed.images[image], posed.frames[frame].has_free_scale, of_parameters);
}

// Returns the equations of a group's frames with the frames of no group eliminated: the lower triangle.
template <int kSize>
Eigen::MatrixXd EquationsOfGroup(const BundleSolver<kSize>& solver, size_t group) {
  const BundleProblem& problem = solver.Problem();
  std::vector<bool> is_grouped(problem.frames.size(), false);
  for (const BundlePriors& priors : problem.priors) {
    for (const int frame : priors.frames) is_grouped[frame] = true;
  }
  std::vector<int> frames;
  for (size_t frame = 0; frame < is_grouped.size(); ++frame) {
    if (!is_grouped[frame]) frames.push_back(static_cast<int>(frame));
  }
  const auto num_eliminated = static_cast<Eigen::Index>(kSize * frames.size());
  frames.insert(frames.end(), problem.priors[group].frames.begin(), problem.priors[group].frames.end());
  const Eigen::MatrixXd all = solver.Cameras().EquationsOf(frames, solver.Equations().reduced);
  const Eigen::Index num_kept = all.rows() - num_eliminated;
  Eigen::MatrixXd kept = all.bottomRightCorner(num_kept, num_kept);
  const Eigen::LLT<Eigen::MatrixXd> factor(all.topLeftCorner(num_eliminated, num_eliminated));
  const Eigen::MatrixXd half = factor.matrixL().solve(all.bottomLeftCorner(num_kept, num_eliminated).transpose());
  kept.template selfadjointView<Eigen::Lower>().rankUpdate(half.transpose(), -1);
  return kept;
}

// Fits a prior group after the minimum of an adjustment that solves a dense system; without component_covariances.
template <int kSize>
PriorFit FitPriors(const BundleSolver<kSize>& solver, size_t group) {
  const BundlePriors& priors = solver.Problem().priors[group];
  const auto size = static_cast<Eigen::Index>(priors.frames.size());
  PriorFit fit{Eigen::MatrixXd(size, 6), Eigen::MatrixXd(6 * size, 6 * size)};
  std::vector<Matrix6d> pose_from_deviation;
  for (Eigen::Index i = 0; i < size; ++i) {
    const PosePriorResidual residual = solver.EvaluatePrior(priors.frames[i], solver.Solution());
    fit.deviations.row(i) = residual.error;
    pose_from_deviation.push_back(residual.jacobian.inverse());
  }
  const Eigen::MatrixXd equations = EquationsOfGroup(solver, group);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      Matrix6d block = equations.template block<6, 6>(kSize * i, kSize * j);
      if (i == j) block = block.template selfadjointView<Eigen::Lower>();
      Matrix6d information = pose_from_deviation[i].transpose() * block * pose_from_deviation[j];
      information.diagonal() -= priors.precision.Between(i, j);
      fit.information(Eigen::seqN(i, 6, size), Eigen::seqN(j, 6, size)) = information;
      fit.information(Eigen::seqN(j, 6, size), Eigen::seqN(i, 6, size)) = information.transpose();
    }
  }
  return fit;
}

// Returns by component the covariance of a frame's parameters that unit variance of the component causes.
template <int kSize>
std::vector<Eigen::MatrixXd> ComponentCovariancesOfFrame(const BundleSolver<kSize>& solver, size_t group,
                                                         const PriorGroup& given, int frame) {
  const BundlePriors& priors = solver.Problem().priors[group];
  const Eigen::MatrixXd covariance = solver.Cameras().ColumnsOfInverse(frame);
  Eigen::MatrixXd with_deviations(6 * priors.frames.size(), kSize);
  for (size_t i = 0; i < priors.frames.size(); ++i) {
    with_deviations(Eigen::seqN(i, 6, priors.frames.size()), Eigen::all) =
        solver.EvaluatePrior(priors.frames[i], solver.Solution()).jacobian *
        covariance.template middleRows<6>(kSize * priors.frames[i]);
  }
  return ComponentCovariances(given, priors.precision, with_deviations);
}

// Fits all prior groups; none if there are too many frames.
template <int kSize>
std::vector<PriorFit> FitAllPriors(const BundleSolver<kSize>& solver, const PosedImages& posed, bool computes_parts) {
  std::vector<PriorFit> fits;
  if (!solver.Cameras().IsDense()) return fits;
  for (size_t group = 0; group < posed.prior_groups.size(); ++group) {
    PriorFit& fit = fits.emplace_back(FitPriors(solver, group));
    if (!computes_parts) continue;
    const PriorGroup& given = posed.prior_groups[group];
    fit.component_covariances.assign(given.components.size(),
                                     std::vector<Matrix6d>(posed.images.size(), Matrix6d::Zero()));
    for (size_t image = 0; image < posed.images.size(); ++image) {
      if (posed.IsDatabase(static_cast<int>(image))) continue;
      const std::vector<Eigen::MatrixXd> of_frame =
          ComponentCovariancesOfFrame(solver, group, given, solver.Problem().index_of_image[image]);
      for (size_t j = 0; j < of_frame.size(); ++j) {
        fit.component_covariances[j][image] = CovarianceOf(posed, image, solver.Problem(), of_frame[j]);
      }
    }
  }
  return fits;
}

template <int kSize>
void SetCovariances(const BundleSolver<kSize>& solver, BundleAdjustmentResult* result) {
  const PosedImages& posed = result->posed;
  const BundleProblem& problem = solver.Problem();
  const std::vector<Eigen::Matrix<double, kSize, kSize>> covariances = solver.Covariances();
  result->image_covariances.assign(posed.images.size(), Matrix6d::Zero());
  for (size_t image = 0; image < posed.images.size(); ++image) {
    const int index = problem.index_of_image[image];
    if (index >= 0) result->image_covariances[image] = CovarianceOf(posed, image, problem, covariances[index]);
  }
  result->frame_covariances.assign(posed.frames.size(), Matrix6d::Zero());
  for (size_t frame = 0; frame < posed.frames.size(); ++frame) {
    const int index = problem.index_of_frame[frame];
    if (index >= 0) result->frame_covariances[frame] = covariances[index].template topLeftCorner<6, 6>();
  }
}

// Returns by image of a query what shared errors add to its covariance; zero for a frame without tracks.
std::vector<Matrix6d> SharedErrorsOfQueries(const PosedImages& posed, const std::vector<IntrinsicsScore>& scores) {
  std::vector<Matrix6d> shared_errors;
  for (const Image& image : posed.images) {
    const Frame& frame = posed.frames[image.frame];
    if (frame.is_database) break;
    const Eigen::MatrixXd& of_frame = scores[image.frame].frame_shared_errors;
    shared_errors.emplace_back(Matrix6d::Zero());
    if (of_frame.size() > 0) shared_errors.back() = ImageCovariance(image, frame.has_free_scale, of_frame);
  }
  return shared_errors;
}

template <int kSize>
BundleAdjustmentResult Adjust(const PosedImages& posed, std::vector<Track> tracks,
                              const BundleAdjustmentOptions& options) {
  BundleSolver<kSize> solver(posed, tracks, options);
  BundleAdjustmentResult result;
  result.summary = solver.Minimize();
  result.posed = posed;
  result.tracks = std::move(tracks);
  if (!result.summary.success) return result;
  result.posed = MovedTo(solver, posed);
  result.prior_fits = FitAllPriors(solver, result.posed, options.computes_covariances);
  if (options.computes_covariances) {
    result.intrinsics_scores =
        ComputeIntrinsicsScores(solver, posed, result.tracks, RobustLoss(options.loss_scale_sigma));
    result.image_shared_errors = SharedErrorsOfQueries(result.posed, result.intrinsics_scores);
    SetCovariances(solver, &result);
  }
  for (size_t track = 0; track < result.tracks.size(); ++track) {
    result.tracks[track].point_in_world = solver.Solution().points[track];
  }
  return result;
}

}  // namespace

BundleAdjustmentResult AdjustBundle(const PosedImages& posed, std::vector<Track> tracks,
                                    const BundleAdjustmentOptions& options) {
  const bool has_factor =
      std::any_of(posed.frames.begin(), posed.frames.end(), [](const Frame& frame) { return frame.has_free_scale; }) ||
      std::any_of(posed.images.begin(), posed.images.end(),
                  [](const Image& image) { return image.log_focal_factor.has_value(); });
  return has_factor ? Adjust<7>(posed, std::move(tracks), options) : Adjust<6>(posed, std::move(tracks), options);
}

}  // namespace lazyloc

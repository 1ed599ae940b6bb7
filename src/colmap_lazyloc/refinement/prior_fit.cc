#include "colmap_lazyloc/refinement/prior_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "colmap_lazyloc/refinement/bundle_solver.h"
#include "colmap_lazyloc/refinement/pose_prior.h"

namespace lazyloc {
namespace {

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

}  // namespace

template <int kSize>
PriorFit FitPriors(const BundleSolver<kSize>& solver, size_t group) {
  const BundlePriors& priors = solver.Problem().priors[group];
  const auto size = static_cast<Eigen::Index>(priors.frames.size());
  PriorFit fit{Eigen::MatrixXd(size, 6), Eigen::MatrixXd(6 * size, 6 * size)};
  std::vector<Eigen::Matrix<double, 6, 6>> pose_from_deviation;
  for (Eigen::Index i = 0; i < size; ++i) {
    const PosePriorResidual residual = solver.EvaluatePrior(priors.frames[i], solver.Solution());
    fit.deviations.row(i) = residual.error;
    pose_from_deviation.push_back(residual.jacobian.inverse());
  }
  const Eigen::MatrixXd equations = EquationsOfGroup(solver, group);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      Eigen::Matrix<double, 6, 6> block = equations.template block<6, 6>(kSize * i, kSize * j);
      if (i == j) block = block.template selfadjointView<Eigen::Lower>();
      Eigen::Matrix<double, 6, 6> information = pose_from_deviation[i].transpose() * block * pose_from_deviation[j];
      information.diagonal() -= priors.precision.Between(i, j);
      fit.information(Eigen::seqN(i, 6, size), Eigen::seqN(j, 6, size)) = information;
      fit.information(Eigen::seqN(j, 6, size), Eigen::seqN(i, 6, size)) = information.transpose();
    }
  }
  return fit;
}

template <int kSize>
std::vector<std::vector<Eigen::MatrixXd>> FrameComponentCovariances(const BundleSolver<kSize>& solver, size_t group,
                                                                    const PriorGroup& given,
                                                                    const std::vector<int>& needed_frames) {
  const BundlePriors& priors = solver.Problem().priors[group];
  std::vector<std::vector<Eigen::MatrixXd>> covariances(given.components.size());
  for (auto& by_frame : covariances) by_frame.resize(solver.Problem().frames.size());
  for (const int frame : needed_frames) {
    const Eigen::MatrixXd covariance = solver.Cameras().ColumnsOfInverse(frame);
    Eigen::MatrixXd with_deviations(6 * priors.frames.size(), kSize);
    for (size_t i = 0; i < priors.frames.size(); ++i) {
      with_deviations(Eigen::seqN(i, 6, priors.frames.size()), Eigen::all) =
          solver.EvaluatePrior(priors.frames[i], solver.Solution()).jacobian *
          covariance.template middleRows<6>(kSize * priors.frames[i]);
    }
    const std::vector<Eigen::MatrixXd> of_frame = ComponentCovariances(given, priors.precision, with_deviations);
    for (size_t j = 0; j < covariances.size(); ++j) covariances[j][frame] = of_frame[j];
  }
  return covariances;
}

template PriorFit FitPriors<6>(const BundleSolver<6>&, size_t);
template PriorFit FitPriors<7>(const BundleSolver<7>&, size_t);
template std::vector<std::vector<Eigen::MatrixXd>> FrameComponentCovariances<6>(const BundleSolver<6>&, size_t,
                                                                                const PriorGroup&,
                                                                                const std::vector<int>&);
template std::vector<std::vector<Eigen::MatrixXd>> FrameComponentCovariances<7>(const BundleSolver<7>&, size_t,
                                                                                const PriorGroup&,
                                                                                const std::vector<int>&);

}  // namespace lazyloc

#include "colmap_lazyloc/noise/variance_estimate.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/refinement/prior_precision.h"

namespace lazyloc {
namespace {

// Maximum standard deviation of a component in pixels, because the images alone determine the deviations only up to a
// common motion and scale: without a prior, A + Q is singular. Poses by GPS are off by about as much. With 100 px, a
// single image with a depth map would fix no position.
constexpr double kMaxStddev = 30;
constexpr int kMaxNumSteps = 12;
// Maximum step of the logarithm of a standard deviation, and the step below which the search has converged: the error
// that remains is about its square.
constexpr double kMaxStep = 1.5, kConvergence = 0.2;

// The log of the likelihood, and its derivatives by the logs x of the components' standard deviations.
struct Slope {
  double log_likelihood = 0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd curvature;  // the negative second derivatives, approximately
};

DeviationLikelihood Linearize(const PriorGroup& group, const PriorFit& fit, double variance_factor) {
  const PriorPrecision precision = ComputePriorPrecision(group);
  const Eigen::Index size = fit.deviations.rows();
  Eigen::VectorXd rhs = fit.information * fit.deviations.reshaped();
  for (Eigen::Index k = 0; k < 6; ++k) rhs.segment(k * size, size) += precision.Of(k) * fit.deviations.col(k);
  return {fit.information / variance_factor, rhs / variance_factor};
}

double HalfLogDeterminant(const Eigen::LLT<Eigen::MatrixXd>& factor) {
  return factor.matrixLLT().diagonal().array().log().sum();
}

// Computes the slope at the variances of `group`. With P the inverse covariance of the deviations as the images
// determine them, u = P p and D_j the covariance by component j, the gradient is u^T D_j u - tr(P D_j). The curvature
// is the average information 2 u^T D_i P D_j u (Gilmour, Thompson and Cullis 1995), because it needs no further
// inverse. Returns false if A + Q is not positive definite.
bool ComputeSlope(const PriorGroup& group, const DeviationLikelihood& linearized, Slope* slope) {
  const auto size = static_cast<Eigen::Index>(group.frames.size());
  const auto num_components = static_cast<Eigen::Index>(group.components.size());
  const PriorPrecision precision = ComputePriorPrecision(group);
  Eigen::MatrixXd matrix = linearized.information;
  for (Eigen::Index k = 0; k < 6; ++k) matrix.block(k * size, k * size, size, size) += precision.Of(k);
  const Eigen::LLT<Eigen::MatrixXd> factor(matrix);
  if (factor.info() != Eigen::Success) return false;
  const Eigen::VectorXd solution = factor.solve(linearized.rhs);
  const Eigen::MatrixXd deviations = solution.reshaped(size, 6);
  slope->log_likelihood = linearized.rhs.dot(solution) / 2 - HalfLogDeterminant(factor) +
                          3 * HalfLogDeterminant(precision.rotation.llt()) +
                          3 * HalfLogDeterminant(precision.position.llt());
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(num_components), degrees_of_freedom = sums;
  Eigen::MatrixXd moved = Eigen::MatrixXd::Zero(6 * size, num_components), weighted = moved;  // D_j u, Q D_j u
  for (Eigen::Index k = 0; k < 6; ++k) {
    // Computes the diagonal block of (A + Q)^-1 by the columns of the inverse factor, which begin with zeros.
    Eigen::MatrixXd root = Eigen::MatrixXd::Identity((6 - k) * size, size);
    const auto remaining = factor.matrixLLT().bottomRightCorner((6 - k) * size, (6 - k) * size);
    remaining.triangularView<Eigen::Lower>().solveInPlace(root);
    const Eigen::MatrixXd& q = precision.Of(k);
    const Eigen::MatrixXd determined = q - q * (root.transpose() * root) * q;
    const Eigen::VectorXd u = q * deviations.col(k);
    for (Eigen::Index j = 0; j < num_components; ++j) {
      const VarianceComponent& component = group.components[j];
      if (!component.Moves(PriorPrecision::PartOf(k))) continue;
      const Eigen::VectorXd of_component = component.variance * (component.shape * u);
      moved.col(j).segment(k * size, size) = of_component;
      weighted.col(j).segment(k * size, size) = q * of_component;
      sums[j] += u.dot(of_component);
      degrees_of_freedom[j] += component.variance * determined.cwiseProduct(component.shape).sum();
    }
  }
  const Eigen::MatrixXd half = factor.matrixL().solve(weighted);
  slope->gradient = sums - degrees_of_freedom;
  slope->curvature = 2 * (moved.transpose() * weighted - half.transpose() * half);
  // Adds curvature where deviations are smaller than their variances, because the average information is small there.
  slope->curvature.diagonal() += (-slope->gradient / 2).cwiseMax(0);
  return true;
}

// Adds the likelihood of the logs x of the standard deviations by what is expected of them.
void AddExpected(const std::vector<ExpectedStddev>& expected, const Eigen::VectorXd& x, Slope* slope) {
  for (Eigen::Index j = 0; j < x.size(); ++j) {
    const double weight = 1 / (expected[j].log_stddev * expected[j].log_stddev);
    const double difference = x[j] - std::log(expected[j].median);
    slope->log_likelihood += (std::log(weight) - weight * difference * difference) / 2;
    slope->gradient[j] -= weight * difference;
    slope->curvature(j, j) += weight;
  }
}

// Returns the step towards the maximum within the bounds.
Eigen::VectorXd StepWithin(const std::vector<ExpectedStddev>& expected, const Eigen::VectorXd& x, Slope slope) {
  for (Eigen::Index j = 0; j < x.size(); ++j) {
    if (slope.gradient[j] > 0 || x[j] > std::log(expected[j].min)) continue;
    // Keeps the component at its minimum.
    slope.gradient[j] = 0;
    slope.curvature.row(j).setZero();
    slope.curvature.col(j).setZero();
    slope.curvature(j, j) = 1;
  }
  Eigen::VectorXd step = slope.curvature.ldlt().solve(slope.gradient).cwiseMax(-kMaxStep).cwiseMin(kMaxStep);
  for (Eigen::Index j = 0; j < x.size(); ++j) {
    step[j] = std::clamp(x[j] + step[j], std::log(expected[j].min), std::log(kMaxStddev)) - x[j];
  }
  return step;
}

}  // namespace

VarianceEstimate EstimateVariances(const PriorGroup& group, const PriorFit& fit, double variance_factor,
                                   const std::vector<ExpectedStddev>& expected) {
  return EstimateVariances(group, Linearize(group, fit, variance_factor), expected);
}

VarianceEstimate EstimateVariances(const PriorGroup& group, const DeviationLikelihood& likelihood,
                                   const std::vector<ExpectedStddev>& expected) {
  PriorGroup tried = group;
  Eigen::VectorXd x(expected.size());
  for (Eigen::Index j = 0; j < x.size(); ++j) x[j] = std::log(expected[j].first);
  Eigen::VectorXd step = Eigen::VectorXd::Zero(x.size());
  double best = -std::numeric_limits<double>::infinity();
  VarianceEstimate estimate;
  for (int i = 0; i < kMaxNumSteps; ++i) {
    const Eigen::VectorXd next = x + step;
    for (Eigen::Index j = 0; j < x.size(); ++j) tried.components[j].variance = std::exp(2 * next[j]);
    Slope slope;
    const bool is_valid = ComputeSlope(tried, likelihood, &slope);
    if (is_valid) AddExpected(expected, next, &slope);
    if (!is_valid || !(slope.log_likelihood >= best)) {
      step /= 2;
      continue;
    }
    x = next;
    best = slope.log_likelihood;
    // Without any deviation, the log of the likelihood is zero.
    estimate.log_bayes_factor = best - slope.curvature.diagonal().array().max(1e-9).log().sum() / 2;
    step = StepWithin(expected, x, slope);
    if (step.cwiseAbs().maxCoeff() > kConvergence) continue;
    x += step;
    break;
  }
  // If the likelihood cannot be computed, nothing is known but what was expected.
  const bool is_known = best > -std::numeric_limits<double>::infinity();
  for (Eigen::Index j = 0; j < x.size(); ++j) {
    estimate.variances.push_back(is_known ? std::exp(2 * x[j]) : expected[j].median * expected[j].median);
  }
  return estimate;
}

}  // namespace lazyloc

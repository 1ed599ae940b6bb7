#include "colmap_lazyloc/refinement/sparse_precision.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include <Eigen/Cholesky>

namespace lazyloc {
namespace {

// With it, the approximation of 500 errors in a grid or a row has a Kullback-Leibler divergence of at most 3.
constexpr Eigen::Index kMaxNumConditions = 20;

// Returns the indices of the earlier errors that differ least from error i.
std::vector<Eigen::Index> FindConditions(const Eigen::MatrixXd& covariance, Eigen::Index i) {
  std::vector<Eigen::Index> earlier(i);
  std::iota(earlier.begin(), earlier.end(), 0);
  if (i <= kMaxNumConditions) return earlier;
  const Eigen::VectorXd differences = covariance.diagonal().head(i) - 2 * covariance.col(i).head(i);
  std::nth_element(earlier.begin(), earlier.begin() + kMaxNumConditions, earlier.end(),
                   [&](Eigen::Index a, Eigen::Index b) {
                     return differences[a] != differences[b] ? differences[a] < differences[b] : a < b;
                   });
  earlier.resize(kMaxNumConditions);
  return earlier;
}

}  // namespace

Eigen::SparseMatrix<double, Eigen::RowMajor> SparseRootOfPrecision(const Eigen::MatrixXd& covariance) {
  std::vector<Eigen::Triplet<double>> elements;
  for (Eigen::Index i = 0; i < covariance.cols(); ++i) {
    const std::vector<Eigen::Index> conditions = FindConditions(covariance, i);
    const Eigen::VectorXd shared = covariance(conditions, i);
    const Eigen::VectorXd weights = covariance(conditions, conditions).ldlt().solve(shared);
    // Rounding may leave nothing of the variance of an error that the conditions determine almost.
    const double smallest = std::numeric_limits<double>::epsilon() * covariance(i, i);
    const double root = 1 / std::sqrt(std::max(covariance(i, i) - shared.dot(weights), smallest));
    for (size_t j = 0; j < conditions.size(); ++j) {
      elements.emplace_back(i, conditions[j], -root * weights[static_cast<Eigen::Index>(j)]);
    }
    elements.emplace_back(i, i, root);
  }
  Eigen::SparseMatrix<double, Eigen::RowMajor> precision_root(covariance.rows(), covariance.cols());
  precision_root.setFromTriplets(elements.begin(), elements.end());
  return precision_root;
}

}  // namespace lazyloc

#include "colmap_lazyloc/epoch/information_factor.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>

namespace lazyloc {
namespace {

using SparseMatrix = Eigen::SparseMatrix<double>;
using Permutation = Eigen::PermutationMatrix<Eigen::Dynamic>;

// Returns an order of the parameters that keeps their Cholesky factor sparse.
Permutation OrderToStaySparse(const SparseMatrix& information) {
  Permutation order;
  Eigen::AMDOrdering<int>()(information, order);
  return order.inverse();
}

}  // namespace

InformationFactor::InformationFactor(const SparseMatrix& information, const std::vector<int>& first_deviations) {
  const auto num_images = static_cast<Eigen::Index>(first_deviations.size());
  const Eigen::Index num_parameters = information.cols(), num_others = num_parameters - 6 * num_images;
  order_ = Eigen::VectorXi::Constant(num_parameters, -1);
  for (Eigen::Index i = 0; i < num_images; ++i) {
    for (int k = 0; k < 6; ++k) {
      order_[first_deviations[i] + k] = static_cast<int>(num_others + k * num_images + i);
    }
  }
  int num_sorted = 0;
  for (int& place : order_) {
    if (place < 0) place = num_sorted++;
  }
  const Permutation deviations_last(order_);
  const SparseMatrix sorted = deviations_last * information * deviations_last.transpose();
  const Permutation sparse = OrderToStaySparse(sorted.topLeftCorner(num_others, num_others));
  for (int& place : order_) {
    if (place < num_others) place = sparse.indices()[place];
  }
  const Permutation order(order_);
  const SparseMatrix ordered = order * information * order.transpose();
  const Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower, Eigen::NaturalOrdering<int>> factor(ordered);
  succeeded_ = factor.info() == Eigen::Success;
  if (!succeeded_) return;
  diagonal_ = factor.vectorD();
  const SparseMatrix lower = factor.matrixL();
  of_others_ = lower.leftCols(num_others);
  of_deviations_ = lower.bottomRightCorner(6 * num_images, 6 * num_images);
}

Eigen::MatrixXd InformationFactor::OnDeviations() const {
  const auto lower = of_deviations_.triangularView<Eigen::UnitLower>();
  const Eigen::MatrixXd scaled = lower * Eigen::MatrixXd(diagonal_.tail(of_deviations_.rows()).asDiagonal());
  return scaled * of_deviations_.triangularView<Eigen::UnitLower>().transpose();
}

InformationFactor::Matrix6d InformationFactor::Covariance(int first, const Eigen::MatrixXd& by_deviations) const {
  // Solves L x = gain, in which most rows stay zero until the deviations.
  Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor> x = decltype(x)::Zero(diagonal_.size(), 6);
  for (int k = 0; k < 6; ++k) x(order_[first + k], k) = 1;
  x.bottomRows(by_deviations.rows()) = by_deviations;
  for (Eigen::Index col = order_.segment<6>(first).minCoeff(); col < of_others_.cols(); ++col) {
    const Eigen::Matrix<double, 1, 6> value = x.row(col);
    if (value.isZero(0)) continue;
    for (SparseMatrix::InnerIterator element(of_others_, col); element; ++element) {
      if (element.row() > col) x.row(element.row()) -= element.value() * value;
    }
  }
  const Eigen::MatrixXd tail =
      of_deviations_.triangularView<Eigen::UnitLower>().solve(Eigen::MatrixXd(x.bottomRows(by_deviations.rows())));
  x.bottomRows(by_deviations.rows()) = tail;
  return x.transpose() * diagonal_.cwiseInverse().asDiagonal() * x;
}

Eigen::MatrixXd InformationFactor::Solve(const Eigen::MatrixXd& columns) const {
  const Permutation order(order_);
  const auto last = of_deviations_.triangularView<Eigen::UnitLower>();
  const Eigen::Index num_others = of_others_.cols(), num_last = of_deviations_.rows();
  Eigen::MatrixXd x = order * columns;
  for (Eigen::Index col = 0; col < num_others; ++col) {
    for (SparseMatrix::InnerIterator element(of_others_, col); element; ++element) {
      if (element.row() > col) x.row(element.row()) -= element.value() * x.row(col);
    }
  }
  x.bottomRows(num_last) = last.solve(Eigen::MatrixXd(x.bottomRows(num_last)));
  x = diagonal_.cwiseInverse().asDiagonal() * x;
  x.bottomRows(num_last) = last.transpose().solve(Eigen::MatrixXd(x.bottomRows(num_last)));
  for (Eigen::Index col = num_others - 1; col >= 0; --col) {
    for (SparseMatrix::InnerIterator element(of_others_, col); element; ++element) {
      if (element.row() > col) x.row(col) -= element.value() * x.row(element.row());
    }
  }
  return order.transpose() * x;
}

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace lazyloc {

// The information of a joint adjustment as L D L^T, with the deviations of the database images last. Their part of L is
// dense, because photos connect them. All other parameters are in an order that keeps L sparse.
class InformationFactor {
 public:
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  // first_deviations: index of the first of six consecutive parameters, by database image.
  InformationFactor(const Eigen::SparseMatrix<double>& information, const std::vector<int>& first_deviations);

  // False if the information is singular. The other functions then have no result.
  bool Succeeded() const { return succeeded_; }
  // Returns the information on the deviations, with all other parameters eliminated: one coordinate of all images after
  // the other.
  Eigen::MatrixXd OnDeviations() const;
  // Returns the covariance of six consecutive parameters, which are not deviations, plus functions of the deviations.
  // first: index of the first parameter. by_deviations: has a column per function, and the rows of OnDeviations.
  Matrix6d Covariance(int first, const Eigen::MatrixXd& by_deviations) const;
  // Returns the product of the information's inverse with columns of values by parameter.
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& columns) const;

 private:
  bool succeeded_ = false;
  Eigen::VectorXi order_;                  // index in L, by parameter
  Eigen::SparseMatrix<double> of_others_;  // their columns of L
  Eigen::MatrixXd of_deviations_;          // their part of L
  Eigen::VectorXd diagonal_;               // D
};

}  // namespace lazyloc

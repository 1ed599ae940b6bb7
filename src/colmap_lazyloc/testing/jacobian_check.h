#pragma once

#include <Eigen/Core>
#include <gtest/gtest.h>

namespace lazyloc {

// Compares a Jacobian with central differences of `function`, which takes a step (a vector with one element per column)
// from the point of the Jacobian and returns a vector with one element per row. tolerance: maximum error of a column
// relative to the largest column, with room for the function's third derivative.
template <typename Function, typename Jacobian>
void ExpectJacobian(const Function& function, const Eigen::MatrixBase<Jacobian>& jacobian, double step = 1e-5,
                    double tolerance = 1e-6) {
  const double scale = jacobian.colwise().norm().maxCoeff();
  for (Eigen::Index col = 0; col < jacobian.cols(); ++col) {
    const Eigen::VectorXd forward = step * Eigen::VectorXd::Unit(jacobian.cols(), col);
    const Eigen::VectorXd after = function(forward), before = function(-forward);
    const Eigen::VectorXd numeric = (after - before) / (2 * step);
    EXPECT_LE((numeric - jacobian.col(col)).norm(), tolerance * scale) << "column " << col;
  }
}

}  // namespace lazyloc

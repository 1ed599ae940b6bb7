#include "colmap_lazyloc/epoch/information_factor.h"

#include <cmath>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

// Returns an information of 5 times 6 parameters, in which only neighbours have elements in common, and of
// 2 more, which have elements in common with all.
Eigen::SparseMatrix<double> MakeInformation() {
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(100, 32);
  for (int row = 0; row < 100; ++row) {
    for (int k = 0; k < 12; ++k) jacobian(row, (row / 25) * 6 + k) = std::sin(1.3 * row * (k + 1) + k);
    jacobian(row, 30 + row % 2) = std::cos(0.7 * row * row);
  }
  const Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  return information.sparseView();
}

TEST(InformationFactor, AgreesWithTheDenseInverse) {
  const Eigen::SparseMatrix<double> information = MakeInformation();
  const InformationFactor factor(information, {6, 18});
  ASSERT_TRUE(factor.Succeeded());
  const Eigen::MatrixXd covariance = Eigen::MatrixXd(information).inverse();
  std::vector<int> deviations;  // in the order of OnDeviations
  for (int k = 0; k < 6; ++k) deviations.insert(deviations.end(), {6 + k, 18 + k});
  const Eigen::MatrixXd expected = covariance(deviations, deviations).inverse();
  EXPECT_TRUE(factor.OnDeviations().isApprox(expected, 1e-9));

  Eigen::MatrixXd by_deviations(12, 6);
  for (int i = 0; i < by_deviations.size(); ++i) by_deviations(i) = std::sin(i * i);
  Eigen::MatrixXd gain = Eigen::MatrixXd::Zero(32, 6);
  gain.middleRows<6>(12).setIdentity();
  for (int i = 0; i < 12; ++i) gain.row(deviations[i]) = by_deviations.row(i);
  EXPECT_TRUE(factor.Covariance(12, by_deviations).isApprox(gain.transpose() * covariance * gain, 1e-9));
  EXPECT_TRUE(factor.Solve(gain).isApprox(covariance * gain, 1e-9));
}

TEST(InformationFactor, NeedsNoDeviations) {
  const Eigen::SparseMatrix<double> information = MakeInformation();
  const InformationFactor factor(information, {});
  EXPECT_TRUE(factor.Covariance(24, Eigen::MatrixXd::Zero(0, 6))
                  .isApprox(Eigen::MatrixXd(information).inverse().block<6, 6>(24, 24), 1e-9));
}

TEST(InformationFactor, SingularInformationIsReported) {
  Eigen::MatrixXd information = MakeInformation();
  information.row(9).setZero();
  information.col(9).setZero();
  EXPECT_FALSE(InformationFactor(information.sparseView(), {6, 18}).Succeeded());
}

}  // namespace
}  // namespace lazyloc

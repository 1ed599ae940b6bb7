#include "colmap_lazyloc/refinement/prior_fit.h"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr int kNumDatabase = 12;
constexpr int kNumParameters = 6 * (1 + kNumDatabase);  // the query comes first
constexpr int kNumTrials = 3000;

// Solves a linear adjustment: minimises |B x - n|^2 + sum |J_d (x_d - e_d)|^2, where n is the image noise and e holds
// the errors of the priors.
class LinearAdjustment {
 public:
  LinearAdjustment() {
    B_ = Random(2 * kNumParameters, kNumParameters);
    Eigen::MatrixXd hessian = B_.transpose() * B_;
    for (int d = 0; d < kNumDatabase; ++d) {
      priors_.push_back(6 * (Matrix6d(Random(6, 6)) / 6 + Matrix6d::Identity()));
      hessian.block<6, 6>(At(d), At(d)) += priors_[d].transpose() * priors_[d];
    }
    inverse_ = hessian.llt().solve(Eigen::MatrixXd::Identity(kNumParameters, kNumParameters));
  }

  // Draws all errors and fits the priors. query_error: the solution for the query, because its truth is zero.
  PriorFit Draw(double prior_variance, double image_variance, Eigen::VectorXd* query_error, Matrix6d* prior_part) {
    Eigen::VectorXd rhs = B_.transpose() * std::sqrt(image_variance) * Random(B_.rows(), 1);
    std::vector<Eigen::VectorXd> prior_errors;
    for (int d = 0; d < kNumDatabase; ++d) {
      prior_errors.push_back(std::sqrt(prior_variance) * priors_[d].inverse() * Random(6, 1));
      rhs.segment<6>(At(d)) += priors_[d].transpose() * priors_[d] * prior_errors[d];
    }
    const Eigen::VectorXd x = inverse_ * rhs;
    std::vector<PriorDeviation> deviations;
    for (int d = 0; d < kNumDatabase; ++d) {
      deviations.push_back({d + 1, {priors_[d] * (x.segment<6>(At(d)) - prior_errors[d]), priors_[d]}});
    }
    *query_error = x.head<6>();
    std::vector<Eigen::MatrixXd> prior_parts;
    const PriorFit fit = FitPriors(deviations, inverse_, 6, &prior_parts);
    *prior_part = prior_parts.front();
    return fit;
  }

  Matrix6d QueryCovariance() const { return inverse_.topLeftCorner<6, 6>(); }

 private:
  static int At(int d) { return 6 * (d + 1); }

  Eigen::MatrixXd Random(Eigen::Index rows, Eigen::Index cols) {
    return Eigen::MatrixXd::NullaryExpr(rows, cols, [&] { return normal_(random_); });
  }

  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
  Eigen::MatrixXd B_, inverse_;
  std::vector<Matrix6d> priors_;
};

struct Variances {
  double prior, image;
};

class PriorFits : public testing::TestWithParam<Variances> {};

TEST_P(PriorFits, FindTheVarianceOfPriorsAndTheCovarianceOfQueries) {
  const auto [prior_variance, image_variance] = GetParam();
  LinearAdjustment adjustment;
  double sum = 0;
  Matrix6d sample_covariance = Matrix6d::Zero(), prior_part;
  for (int trial = 0; trial < kNumTrials; ++trial) {
    Eigen::VectorXd error;
    sum += adjustment.Draw(prior_variance, image_variance, &error, &prior_part).VarianceFactor(image_variance);
    sample_covariance += error * error.transpose() / kNumTrials;
  }
  EXPECT_NEAR(sum / kNumTrials, prior_variance, 0.05 * prior_variance + 0.05);
  const Matrix6d covariance =
      image_variance * adjustment.QueryCovariance() + (prior_variance - image_variance) * prior_part;
  EXPECT_LE((sample_covariance - covariance).norm(), 0.1 * covariance.norm());
}

INSTANTIATE_TEST_SUITE_P(AsStatedAndOtherwise, PriorFits,
                         testing::Values(Variances{1, 1}, Variances{25, 1}, Variances{0, 1}, Variances{4, 0.25}));

TEST(PriorFit, WithoutPriorsIsAsStated) { EXPECT_EQ(PriorFit().VarianceFactor(7), 1); }

}  // namespace
}  // namespace lazyloc

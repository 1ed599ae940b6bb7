#pragma once

#include <algorithm>
#include <map>

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

namespace lazyloc {

// Covariance of an estimate whose observations come in clusters with common errors: the observations of a cluster err
// alike, those of different clusters independently. Compares the squares of the clusters' influences on the estimate
// with those of single observations (the cluster-robust covariance of Liang and Zeger, Biometrika 73, 1986; Cameron and
// Miller, Journal of Human Resources 50, 2015).
template <int kSize>
class ClusterCovariance {
 public:
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;

  // influence: what one observation moves the estimate by.
  void Add(int cluster, const Vector& influence) {
    Cluster& sum = clusters_[cluster];
    sum.influence += influence;
    ++sum.num_observations;
    total_.influence += influence;
    ++total_.num_observations;
    independent_ += influence * influence.transpose();
  }

  size_t NumClusters() const { return clusters_.size(); }

  // Returns by how much errors of clusters enlarge the covariance of the estimate, which is `covariance` for
  // independent observations: nothing in directions in which the clusters scatter less.
  Matrix Excess(const Matrix& covariance) const {
    Matrix excess = -independent_;
    for (const auto& [index, cluster] : clusters_) {
      // Subtracts the cluster's share of the total, which is that of a prior: without one, the influences cancel out.
      const Vector deviation =
          cluster.influence - cluster.num_observations / total_.num_observations * total_.influence;
      excess += deviation * deviation.transpose();
    }
    // Takes the positive part in units of the covariance, because the result must not depend on the parameters' units.
    const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix> solver(excess, covariance);
    const Matrix root = covariance * solver.eigenvectors();
    return root * solver.eigenvalues().cwiseMax(0).asDiagonal() * root.transpose();
  }

  // Returns the factor on a covariance whose size the clusters tell, because the estimate makes the influences of few
  // clusters too small. num_parameters: number of unknowns of the estimate. There must be a cluster.
  double SmallSampleFactor(int num_parameters) const {
    const auto num_clusters = static_cast<double>(clusters_.size());
    return num_clusters / std::max(num_clusters - num_parameters, num_clusters / kMaxSmallSampleFactor);
  }

 private:
  // Maximum factor, because for few clusters there is no unbiased one.
  static constexpr double kMaxSmallSampleFactor = 3;

  struct Cluster {
    Vector influence = Vector::Zero();
    double num_observations = 0;
  };

  std::map<int, Cluster> clusters_;
  Cluster total_;
  Matrix independent_ = Matrix::Zero();
};

}  // namespace lazyloc

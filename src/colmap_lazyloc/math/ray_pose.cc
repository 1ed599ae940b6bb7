#include "colmap_lazyloc/math/ray_pose.h"

#include <algorithm>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

using Svd = Eigen::JacobiSVD<Eigen::Matrix3d>;

constexpr int kBoth = Eigen::ComputeFullU | Eigen::ComputeFullV;

// Returns the number of points that lie on both rays.
int CountInFront(const Rigid3d& query_from_other, const Rays& other, const Rays& query) {
  const Eigen::Vector3d& t = query_from_other.translation;
  int count = 0;
  for (size_t i = 0; i < other.size(); ++i) {
    const Eigen::Vector3d turned = query_from_other.rotation * other[i];
    // Compares the distances at which the rays are nearest, times 1 - cosine^2, with zero.
    const double cosine = turned.dot(query[i]), along_other = t.dot(turned), along_query = t.dot(query[i]);
    count += cosine * along_query > along_other && along_query > cosine * along_other;
  }
  return count;
}

}  // namespace

std::vector<double> SquaredEpipolarErrors(const Rays& other, const Rays& query, const Eigen::Matrix3d& E) {
  std::vector<double> squared(other.size());
  for (size_t i = 0; i < other.size(); ++i) {
    const Eigen::Vector3d normal = E * other[i];
    const double error = query[i].dot(normal);
    squared[i] = error * error / std::max(normal.squaredNorm() + (E.transpose() * query[i]).squaredNorm(), 1e-300);
  }
  return squared;
}

Eigen::Matrix3d FitEssentialMatrix(const Rays& other, const Rays& query) {
  Eigen::Matrix<double, 9, 9> sum = Eigen::Matrix<double, 9, 9>::Zero();
  for (size_t i = 0; i < other.size(); ++i) {
    const Eigen::Matrix3d product = query[i] * other[i].transpose();
    const Eigen::Map<const Eigen::Matrix<double, 9, 1>> row(product.data());
    sum += row * row.transpose();
  }
  const Eigen::Matrix<double, 9, 1> least =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>>(sum).eigenvectors().col(0);
  const Svd svd(Eigen::Map<const Eigen::Matrix3d>(least.data()), kBoth);
  return svd.matrixU() * Eigen::Vector3d(1, 1, 0).asDiagonal() * svd.matrixV().transpose();
}

Rigid3d PoseOfEssentialMatrix(const Eigen::Matrix3d& E, const Rays& other, const Rays& query) {
  const Svd svd(E, kBoth);
  const Eigen::Matrix3d quarter_turn = (Eigen::Matrix3d() << 0, 1, 0, -1, 0, 0, 0, 0, 1).finished();
  Rigid3d best;
  int best_count = -1;
  for (const Eigen::Matrix3d& turn : {quarter_turn, Eigen::Matrix3d(quarter_turn.transpose())}) {
    Eigen::Matrix3d rotation = svd.matrixU() * turn * svd.matrixV().transpose();
    rotation *= rotation.determinant();  // 1 or -1
    for (const double sign : {1.0, -1.0}) {
      const Rigid3d pose{Eigen::Quaterniond(rotation).normalized(), sign * svd.matrixU().col(2)};
      const int count = CountInFront(pose, other, query);
      if (count <= best_count) continue;
      best_count = count;
      best = pose;
    }
  }
  return best;
}

Eigen::Quaterniond FitRotationOfRays(const Rays& other, const Rays& query) {
  constexpr int kNumRounds = 6;
  Eigen::Quaterniond rotation;
  std::vector<double> errors(other.size(), 0);
  double max_error = 0;
  for (int round = 0; round < kNumRounds; ++round) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < other.size(); ++i) {
      if (errors[i] <= max_error) sum += query[i] * other[i].transpose();
    }
    const Svd svd(sum, kBoth);
    const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant();
    rotation = Eigen::Matrix3d(svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose());
    for (size_t i = 0; i < other.size(); ++i) errors[i] = (rotation * other[i] - query[i]).norm();
    max_error = Median(errors);
  }
  return rotation.normalized();
}

}  // namespace lazyloc

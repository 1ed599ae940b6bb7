#include "colmap_lazyloc/translation/relative_direction.h"

#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/robust_weights.h"

namespace lazyloc {
namespace {

constexpr int kNumIterations = 10;

// Squared error of the epipolar constraint over its variance, to first order in the rays' noise (Sampson's distance).
double SquaredError(const RayPair& pair, const Eigen::Vector3d& normal, const Eigen::Vector3d& dir, double* variance) {
  const double slope = dir.cross(pair.ray1_in_world).squaredNorm() + dir.cross(pair.ray2_in_world).squaredNorm();
  *variance = pair.stddev_rad * pair.stddev_rad * std::max(slope, 1e-12);
  const double error = normal.dot(dir);
  return error * error / *variance;
}

// Twice the number of ray pairs that meet in front of both cameras, less their number, for baseline `dir`.
int CheiralityVote(const std::vector<RayPair>& rays, const Eigen::Vector3d& dir) {
  int vote = 0;
  for (const RayPair& pair : rays) {
    const Eigen::Vector3d normal = pair.ray1_in_world.cross(pair.ray2_in_world);
    const double depth1 = dir.cross(pair.ray2_in_world).dot(normal);
    const double depth2 = dir.cross(pair.ray1_in_world).dot(normal);
    vote += (depth1 > 0 && depth2 > 0) - (depth1 < 0 && depth2 < 0);
  }
  return vote;
}

}  // namespace

RelativeDirection EstimateRelativeDirection(const std::vector<RayPair>& rays) {
  RelativeDirection result;
  if (rays.size() < 2) return result;
  std::vector<Eigen::Vector3d> normals;
  Eigen::Matrix3d system = Eigen::Matrix3d::Zero();
  for (const RayPair& pair : rays) {
    normals.push_back(pair.ray1_in_world.cross(pair.ray2_in_world));
    system += normals.back() * normals.back().transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  Eigen::Vector3d dir = eigen.computeDirect(system).eigenvectors().col(0);
  for (int i = 0; i < kNumIterations; ++i) {
    system.setZero();
    result.num_inliers = 0;
    for (size_t k = 0; k < rays.size(); ++k) {
      double variance;
      const double squared_error = SquaredError(rays[k], normals[k], dir, &variance);
      if (squared_error < 9) ++result.num_inliers;
      system += GemanMcClureWeight(squared_error, 2.0) / variance * normals[k] * normals[k].transpose();
    }
    const Eigen::Vector3d previous = dir;
    dir = eigen.compute(system).eigenvectors().col(0);
    if (previous.cross(dir).norm() < 1e-12) break;
  }
  const int vote = CheiralityVote(rays, dir);
  if (vote == 0) return result;
  result.dir_1to2_in_world = (vote > 0 ? 1.0 : -1.0) * dir.normalized();
  // The tangent plane's information is the system's second eigenvalue.
  const double information = eigen.eigenvalues()(1);
  result.stddev_rad = information > 0 ? 1 / std::sqrt(information) : std::numeric_limits<double>::infinity();
  return result;
}

}  // namespace lazyloc

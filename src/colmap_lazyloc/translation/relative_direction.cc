#include "colmap_lazyloc/translation/relative_direction.h"

#include <algorithm>
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

// Whether more ray pairs than chance and a few outliers explain are not parallel: without parallax the rays' noise would
// feign a direction.
bool HasParallax(const std::vector<RayPair>& rays, const std::vector<Eigen::Vector3d>& normals) {
  size_t num_with_parallax = 0;
  for (size_t i = 0; i < rays.size(); ++i) num_with_parallax += normals[i].norm() > 4 * M_SQRT2 * rays[i].stddev_rad;
  return num_with_parallax >= 5 && 20 * num_with_parallax >= rays.size();
}

// The direction, of those that two ray pairs give each, that most ray pairs agree with. The pairs are taken from all over
// the list in a fixed order: the same input gives the same start.
Eigen::Vector3d StartDirection(const std::vector<RayPair>& rays, const std::vector<Eigen::Vector3d>& normals) {
  constexpr size_t kNumHypotheses = 30, kNumVoters = 100;
  const size_t num_rays = rays.size(), stride = std::max<size_t>(1, num_rays / kNumVoters);
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  double best_score = -1;
  for (size_t h = 0; h < kNumHypotheses; ++h) {
    const size_t a = (h * num_rays) / kNumHypotheses, b = (a + num_rays / 2 + 7 * h) % num_rays;
    const Eigen::Vector3d dir = normals[a].cross(normals[b]).normalized();
    if (!(dir.squaredNorm() > 0.5)) continue;
    double score = 0;
    for (size_t i = 0; i < num_rays; i += stride) {
      double variance;
      score += GemanMcClureWeight(SquaredError(rays[i], normals[i], dir, &variance), 4.0);
    }
    if (score > best_score) {
      best_score = score;
      best = dir;
    }
  }
  return best;
}

}  // namespace

RelativeDirection EstimateRelativeDirection(const std::vector<RayPair>& rays) {
  RelativeDirection result;
  if (rays.size() < 2) return result;
  std::vector<Eigen::Vector3d> normals;
  for (const RayPair& pair : rays) normals.push_back(pair.ray1_in_world.cross(pair.ray2_in_world));
  if (!HasParallax(rays, normals)) return result;
  Eigen::Vector3d dir = StartDirection(rays, normals);
  if (dir.isZero()) return result;
  Eigen::Matrix3d system;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  for (int i = 0; i < kNumIterations; ++i) {
    system.setZero();
    for (size_t k = 0; k < rays.size(); ++k) {
      double variance;
      const double squared_error = SquaredError(rays[k], normals[k], dir, &variance);
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

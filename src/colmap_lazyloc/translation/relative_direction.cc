#include "colmap_lazyloc/translation/relative_direction.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/robust_weights.h"

namespace lazyloc {
namespace {

constexpr int kNumIterations = 10;
constexpr double kConvergenceSigma = 1e-3;  // end when the direction moves by less, in its standard deviations

// Geman-McClure weight of the epipolar constraint, whose squared error over its variance is to first order in the rays'
// noise Sampson's distance; and the variance. The squared norm of dir x ray is 1 - (dir . ray)^2.
double Weight(const RayPair& pair, const Eigen::Vector3d& normal, const Eigen::Vector3d& dir, double scale,
              double* variance) {
  const double cos1 = dir.dot(pair.ray1_in_world), cos2 = dir.dot(pair.ray2_in_world), error = normal.dot(dir);
  *variance = pair.stddev_rad * pair.stddev_rad * std::max(2 - cos1 * cos1 - cos2 * cos2, 1e-12);
  return GemanMcClureWeight(error * error / *variance, scale);
}

// Twice the number of ray pairs that meet in front of both cameras, less their number, for baseline `dir`.
int CheiralityVote(const std::vector<RayPair>& rays, const std::vector<Eigen::Vector3d>& normals,
                   const Eigen::Vector3d& dir) {
  int vote = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const double depth1 = dir.cross(rays[i].ray2_in_world).dot(normals[i]);
    const double depth2 = dir.cross(rays[i].ray1_in_world).dot(normals[i]);
    vote += (depth1 > 0 && depth2 > 0) - (depth1 < 0 && depth2 < 0);
  }
  return vote;
}

// Whether more ray pairs than chance and a few outliers explain are not parallel: without parallax the rays' noise
// would feign a direction.
bool HasParallax(const std::vector<RayPair>& rays, const std::vector<Eigen::Vector3d>& normals) {
  size_t num_with_parallax = 0;
  for (size_t i = 0; i < rays.size(); ++i) num_with_parallax += normals[i].norm() > 4 * M_SQRT2 * rays[i].stddev_rad;
  return num_with_parallax >= 5 && 20 * num_with_parallax >= rays.size();
}

// The direction, of those that two ray pairs give each, that most ray pairs agree with. The pairs are taken from all
// over the list in a fixed order: the same input gives the same start.
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
      score += Weight(rays[i], normals[i], dir, 4.0, &variance);
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
  normals.reserve(rays.size());
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
      const double weight = Weight(rays[k], normals[k], dir, 2.0, &variance);
      system += (weight / variance * normals[k]).lazyProduct(normals[k].transpose());
    }
    const Eigen::Vector3d previous = dir;
    dir = eigen.compute(system).eigenvectors().col(0);
    // Far below what the rays' noise leaves open: the squared angle times the tangent plane's information.
    if (previous.cross(dir).squaredNorm() * eigen.eigenvalues()(1) < kConvergenceSigma * kConvergenceSigma) break;
  }
  const int vote = CheiralityVote(rays, normals, dir);
  if (vote == 0) return result;
  result.dir_1to2_in_world = (vote > 0 ? 1.0 : -1.0) * dir.normalized();
  // The tangent plane's information is the system's second eigenvalue.
  const double information = eigen.eigenvalues()(1);
  result.stddev_rad = information > 0 ? 1 / std::sqrt(information) : std::numeric_limits<double>::infinity();
  return result;
}

}  // namespace lazyloc

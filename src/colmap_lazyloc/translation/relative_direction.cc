#include "colmap_lazyloc/translation/relative_direction.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/two_rays.h"

namespace lazyloc {
namespace {

constexpr int kNumIterations = 10;
constexpr double kConvergenceSigma = 0.05;  // iterations end when the direction changes by fewer standard deviations

// Returns the Geman-McClure weight of a match's epipolar constraint and sets the variance of the constraint. The error
// in standard deviations is SampsonError, here with the normal ray1 x ray2 computed once for all directions, and with
// |dir x ray|^2 = 1 - (dir . ray)^2.
double Weight(const RayMatch& match, const Eigen::Vector3d& normal, const Eigen::Vector3d& dir, double scale,
              double* variance) {
  const double cos1 = dir.dot(match.ray1), cos2 = dir.dot(match.ray2), error = normal.dot(dir);
  *variance = match.stddev1_rad * match.stddev1_rad * std::max(1 - cos2 * cos2, 1e-12) +
              match.stddev2_rad * match.stddev2_rad * std::max(1 - cos1 * cos1, 1e-12);
  return GemanMcClureWeight(error * error / *variance, scale);
}

// Returns the number of matches that meet in front of both cameras minus the number that meet behind both, for baseline
// `dir`.
int CheiralityVote(const std::vector<RayMatch>& matches, const Eigen::Vector3d& dir) {
  int vote = 0;
  for (const RayMatch& match : matches) {
    const auto nearest = FindNearestPoints(match.ray1, match.ray2, dir, 0);
    if (nearest) vote += nearest->AreAhead() - (nearest->distance1 < 0 && nearest->distance2 < 0);
  }
  return vote;
}

// True if more matches have parallax than noise and a few outliers explain: at least 5 matches and 5 %. Without
// parallax, the noise of the rays would determine the direction.
bool HasParallax(const std::vector<RayMatch>& matches, const std::vector<Eigen::Vector3d>& normals) {
  size_t num_with_parallax = 0;
  for (size_t i = 0; i < matches.size(); ++i) {
    num_with_parallax += normals[i].norm() > 4 * std::hypot(matches[i].stddev1_rad, matches[i].stddev2_rad);
  }
  return num_with_parallax >= 5 && 20 * num_with_parallax >= matches.size();
}

// Returns the direction that the largest number of matches agrees with, among the directions that two matches give
// each. The hypotheses are spread over the whole list in a fixed order, so that the same input gives the same start.
// Returns zero if no hypothesis is valid.
Eigen::Vector3d StartDirection(const std::vector<RayMatch>& matches, const std::vector<Eigen::Vector3d>& normals) {
  constexpr size_t kNumHypotheses = 30, kNumVoters = 100;
  const size_t num_matches = matches.size(), stride = std::max<size_t>(1, num_matches / kNumVoters);
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  double best_score = -1;
  for (size_t h = 0; h < kNumHypotheses; ++h) {
    const size_t a = (h * num_matches) / kNumHypotheses, b = (a + num_matches / 2 + 7 * h) % num_matches;
    const Eigen::Vector3d dir = normals[a].cross(normals[b]).normalized();
    if (!(dir.squaredNorm() > 0.5)) continue;
    double score = 0;
    for (size_t i = 0; i < num_matches; i += stride) {
      double variance;
      score += Weight(matches[i], normals[i], dir, 4.0, &variance);
    }
    if (score > best_score) {
      best_score = score;
      best = dir;
    }
  }
  return best;
}

}  // namespace

RelativeDirection EstimateRelativeDirection(const std::vector<RayMatch>& matches) {
  RelativeDirection result;
  if (matches.size() < 2) return result;
  std::vector<Eigen::Vector3d> normals;
  normals.reserve(matches.size());
  for (const RayMatch& match : matches) normals.push_back(match.ray1.cross(match.ray2));
  if (!HasParallax(matches, normals)) return result;
  Eigen::Vector3d dir = StartDirection(matches, normals);
  if (dir.isZero()) return result;
  Eigen::Matrix3d system;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  for (int i = 0; i < kNumIterations; ++i) {
    system.setZero();
    for (size_t k = 0; k < matches.size(); ++k) {
      double variance;
      const double weight = Weight(matches[k], normals[k], dir, 2.0, &variance);
      system += (weight / variance * normals[k]).lazyProduct(normals[k].transpose());
    }
    const Eigen::Vector3d previous = dir;
    dir = eigen.compute(system).eigenvectors().col(0);
    // Compares the squared angle times the information of the tangent plane, which is the squared change in standard
    // deviations.
    if (previous.cross(dir).squaredNorm() * eigen.eigenvalues()(1) < kConvergenceSigma * kConvergenceSigma) break;
  }
  const int vote = CheiralityVote(matches, dir);
  if (vote == 0) return result;
  result.dir_1to2_in_world = (vote > 0 ? 1.0 : -1.0) * dir.normalized();
  // Takes the second eigenvalue of the system, because it is the information in the worse direction of the tangent
  // plane.
  const double information = eigen.eigenvalues()(1);
  result.stddev_rad = information > 0 ? 1 / std::sqrt(information) : std::numeric_limits<double>::infinity();
  return result;
}

}  // namespace lazyloc

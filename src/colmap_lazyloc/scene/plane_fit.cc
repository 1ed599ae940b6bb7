#include "colmap_lazyloc/scene/plane_fit.h"

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {

PlaneFit FitPlane(const Rigid3d& cam_from_world, const TrackRefs& tracks) {
  constexpr int kNumIterations = 5;
  const auto num = static_cast<Eigen::Index>(tracks.size());
  PlaneFit fit;
  fit.rays.resize(num, 3);
  Eigen::VectorXd inverse_distances(num), weights = Eigen::VectorXd::Ones(num);
  for (Eigen::Index i = 0; i < num; ++i) {
    const Eigen::Vector3d point = cam_from_world * tracks[i]->point_in_world;
    fit.rays.row(i) = point.normalized();
    inverse_distances[i] = 1 / point.norm();
  }
  for (int i = 0; i < kNumIterations; ++i) {
    const Eigen::Matrix<double, 3, Eigen::Dynamic> weighted = fit.rays.transpose() * weights.asDiagonal();
    fit.normal = (weighted * fit.rays).ldlt().solve(weighted * inverse_distances);
    fit.errors = fit.rays * fit.normal - inverse_distances;
    const Eigen::VectorXd sizes = fit.errors.cwiseAbs();
    const double scale = 2 * Median({sizes.begin(), sizes.end()}) + 1e-12 * fit.normal.norm();
    weights = 1 / (1 + (fit.errors / scale).array().square());
  }
  return fit;
}

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/covariance.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/robust_weights.h"

namespace lazyloc {
namespace {

// Of an observation's error, from pixels to standard deviations.
double ResidualFromPx(const View& view, const Track& track) { return 1 / (track.noise_ratio * view.noise_px); }

}  // namespace

double VarianceFactor(const std::vector<View>& views, const std::vector<Track>& tracks, double weight_scale) {
  double squared_sum = 0, freedom = -6;
  for (const Track& track : tracks) {
    freedom -= 3;
    for (const TrackObservation& element : track.observations) {
      const View& view = views[element.view];
      const Eigen::Vector2d error_px =
          ReprojectionError(element.observation, view.cam_from_world * track.point_in_world);
      const double squared_error = (ResidualFromPx(view, track) * error_px).squaredNorm();
      const double weight = CauchyWeight(squared_error, weight_scale);
      squared_sum += weight * squared_error;
      freedom += 2 * weight;
    }
  }
  return squared_sum / std::max(freedom, 1.0);
}

double RelativePoseStddev(const Eigen::Matrix<double, 6, 6>& covariance, double distance) {
  Eigen::Matrix<double, 6, 1> scale;
  scale << Eigen::Vector3d::Ones(), Eigen::Vector3d::Constant(1 / distance);
  const Eigen::Matrix<double, 6, 6> relative = scale.asDiagonal() * covariance * scale.asDiagonal();
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>>(relative, Eigen::EigenvaluesOnly)
                       .eigenvalues()
                       .maxCoeff());
}

double MedianDistance(const View& view, const std::vector<Track>& tracks) {
  std::vector<double> distances;
  for (const Track& track : tracks) distances.push_back((view.cam_from_world * track.point_in_world).norm());
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/covariance.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"

namespace lazyloc {
namespace {

// Of an observation's error, from pixels to standard deviations.
double ResidualFromPx(const View& view, const Track& track) { return 1 / (track.noise_ratio * view.noise_px); }

}  // namespace

Eigen::Matrix<double, 6, 6> PoseInformation(const std::vector<View>& views, const std::vector<Track>& tracks, int view,
                                            double weight_scale) {
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  for (const Track& track : tracks) {
    Eigen::Matrix3d point_information = Eigen::Matrix3d::Zero();
    Eigen::Matrix<double, 6, 6> pose_information = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 3> cross = Eigen::Matrix<double, 6, 3>::Zero();
    for (const TrackObservation& element : track.observations) {
      const Rigid3d& cam_from_world = views[element.view].cam_from_world;
      const LinearProjection projection =
          ProjectionInCam(element.observation).Scaled(ResidualFromPx(views[element.view], track));
      const Eigen::Matrix3d rotation = cam_from_world.rotation.toRotationMatrix();
      const Eigen::Vector3d rotated = rotation * track.point_in_world;
      Eigen::Matrix<double, 2, 3> jacobian;
      const Eigen::Vector2d error = projection.Error(rotated + cam_from_world.translation, &jacobian);
      const double weight = CauchyWeight(error.squaredNorm(), weight_scale);
      const Eigen::Matrix<double, 2, 3> point_jacobian = jacobian * rotation;
      point_information += weight * point_jacobian.transpose() * point_jacobian;
      if (element.view != view) continue;
      Eigen::Matrix<double, 2, 6> pose_jacobian;
      pose_jacobian << -jacobian * Hat(rotated), jacobian;
      pose_information += weight * pose_jacobian.transpose() * pose_jacobian;
      cross += weight * pose_jacobian.transpose() * point_jacobian;
    }
    const Eigen::LDLT<Eigen::Matrix3d> factor(point_information);
    if (!factor.isPositive() || factor.vectorD().minCoeff() <= 0) continue;
    information += pose_information - cross * factor.solve(cross.transpose());
  }
  return information;
}

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

double RelativePoseStddev(const Eigen::Matrix<double, 6, 6>& information, double distance) {
  Eigen::Matrix<double, 6, 1> scale;
  scale << Eigen::Vector3d::Ones(), Eigen::Vector3d::Constant(distance);
  const Eigen::Matrix<double, 6, 6> relative = scale.asDiagonal() * information * scale.asDiagonal();
  const double smallest =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>>(relative, Eigen::EigenvaluesOnly).eigenvalues()(0);
  return smallest > 0 ? 1 / std::sqrt(smallest) : std::numeric_limits<double>::infinity();
}

double MedianDistance(const View& view, const std::vector<Track>& tracks) {
  std::vector<double> distances;
  for (const Track& track : tracks) distances.push_back((view.cam_from_world * track.point_in_world).norm());
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

}  // namespace lazyloc

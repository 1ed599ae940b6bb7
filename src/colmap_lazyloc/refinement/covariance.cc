#include "colmap_lazyloc/refinement/covariance.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {

double VarianceFactor(const std::vector<View>& views, const std::vector<Track>& tracks, double weight_scale) {
  const auto is_free = [](const View& view) { return !view.is_database && !view.rig_link; };
  double squared_sum = 0, freedom = -6.0 * static_cast<double>(std::count_if(views.begin(), views.end(), is_free));
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

Eigen::Matrix3d PositionCovariance(const Rigid3d& cam_from_world, const Eigen::Matrix<double, 6, 6>& covariance) {
  // C = -R^T t, R <- exp(w) R: dC = -R^T (Hat(t) w + dt).
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << Hat(cam_from_world.translation), Eigen::Matrix3d::Identity();
  jacobian = -cam_from_world.rotation.conjugate().toRotationMatrix() * jacobian.eval();
  return jacobian * covariance * jacobian.transpose();
}

Eigen::Matrix<double, 6, 6> LinkedCovariance(const RigLink& link, bool seeks_scale,
                                             const Eigen::MatrixXd& reference_covariance) {
  // x_cam = R x_reference + t turns the tangent by R.
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(6, reference_covariance.cols());
  const Eigen::Matrix3d rotation = link.cam_from_reference.rotation.toRotationMatrix();
  jacobian.topLeftCorner<3, 3>() = jacobian.block<3, 3>(3, 3) = rotation;
  if (seeks_scale) jacobian.col(6).tail<3>() = link.cam_from_reference.translation;
  return jacobian * reference_covariance * jacobian.transpose();
}

PoseSpread ComputePoseSpread(const Rigid3d& cam_from_world, const Eigen::Matrix<double, 6, 6>& covariance) {
  using Solver = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>;
  const Solver rotation(covariance.topLeftCorner<3, 3>(), Eigen::EigenvaluesOnly);
  const Solver position(PositionCovariance(cam_from_world, covariance));
  PoseSpread spread;
  spread.rotation_stddev_rad = std::sqrt(rotation.eigenvalues()[2]);
  spread.position_stddevs = position.eigenvalues().reverse().cwiseMax(0).cwiseSqrt();
  spread.weakest_direction_in_world = position.eigenvectors().col(2);
  // Of the two that mean the same axis, the one whose largest coordinate is positive.
  Eigen::Index largest;
  spread.weakest_direction_in_world.cwiseAbs().maxCoeff(&largest);
  if (spread.weakest_direction_in_world[largest] < 0) spread.weakest_direction_in_world *= -1;
  return spread;
}

double MedianDistance(const View& view, const std::vector<Track>& tracks) {
  std::vector<double> distances;
  for (const Track& track : tracks) distances.push_back((view.cam_from_world * track.point_in_world).norm());
  return Median(std::move(distances));
}

}  // namespace lazyloc

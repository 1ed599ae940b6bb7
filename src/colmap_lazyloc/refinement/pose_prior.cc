#include "colmap_lazyloc/refinement/pose_prior.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// As many views of the initial noise weigh as much as the measured ones.
constexpr double kNumPriorViews = 3;

double Median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace

PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& cam_from_world) {
  PosePriorResidual residual;
  const Eigen::Matrix3d world_from_cam = cam_from_world.rotation.conjugate().toRotationMatrix();
  residual.error.head<3>() =
      LogSO3(cam_from_world.rotation * prior.cam_from_world.rotation.conjugate()) / prior.rotation_stddev_rad;
  residual.error.tail<3>() = (CamInWorld(cam_from_world) - CamInWorld(prior.cam_from_world)) / prior.position_stddev;
  // To first order in the rotation's deviation.
  residual.jacobian.setZero();
  residual.jacobian.topLeftCorner<3, 3>().diagonal().setConstant(1 / prior.rotation_stddev_rad);
  residual.jacobian.bottomLeftCorner<3, 3>() =
      -world_from_cam * Hat(cam_from_world.translation) / prior.position_stddev;
  residual.jacobian.bottomRightCorner<3, 3>() = -world_from_cam / prior.position_stddev;
  return residual;
}

std::vector<ViewScale> MeasureViewScales(const std::vector<View>& views, const std::vector<Track>& tracks) {
  std::vector<std::vector<double>> focal_lengths_px(views.size()), distances(views.size());
  for (const Track& track : tracks) {
    for (const TrackObservation& element : track.observations) {
      focal_lengths_px[element.view].push_back(1 / RadFromPx(element.observation));
      distances[element.view].push_back((views[element.view].cam_from_world * track.point_in_world).norm());
    }
  }
  std::vector<ViewScale> scales(views.size());
  for (size_t view = 0; view < views.size(); ++view) {
    if (!distances[view].empty()) scales[view] = {Median(&focal_lengths_px[view]), Median(&distances[view])};
  }
  return scales;
}

PosePrior MakePosePrior(const Rigid3d& cam_from_world, const DatabasePoseNoise& noise, const ViewScale& scale) {
  return {cam_from_world, noise.rotation_px / scale.focal_length_px,
          noise.position_px * scale.distance / scale.focal_length_px};
}

DatabasePoseNoise EstimateDatabasePoseNoise(const std::vector<View>& views, const std::vector<ViewScale>& scales,
                                            const std::vector<Eigen::Matrix<double, 6, 6>>& pose_covariances,
                                            double variance_factor, const DatabasePoseNoise& initial) {
  double freedom = 3 * kNumPriorViews;
  double rotation_sum = freedom * initial.rotation_px * initial.rotation_px;
  double position_sum = freedom * initial.position_px * initial.position_px;
  for (size_t view = 0; view < views.size(); ++view) {
    if (!views[view].prior) continue;
    const PosePrior in_px = MakePosePrior(views[view].prior->cam_from_world, {1, 1}, scales[view]);
    const PosePriorResidual residual = EvaluatePosePrior(in_px, views[view].cam_from_world);
    const Eigen::Matrix<double, 6, 6> spread =
        variance_factor * residual.jacobian * pose_covariances[view] * residual.jacobian.transpose();
    rotation_sum += residual.error.head<3>().squaredNorm() + spread.diagonal().head<3>().sum();
    position_sum += residual.error.tail<3>().squaredNorm() + spread.diagonal().tail<3>().sum();
    freedom += 3;
  }
  return {std::sqrt(rotation_sum / freedom), std::sqrt(position_sum / freedom)};
}

}  // namespace lazyloc

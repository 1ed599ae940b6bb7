#include "colmap_lazyloc/refinement/pose_prior.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

constexpr double kNumExpectedViews = 3;

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

PosePrior MakePosePrior(const Rigid3d& cam_from_world, double noise_px, const ViewScale& scale) {
  return {cam_from_world, noise_px / scale.focal_length_px, noise_px * scale.distance / scale.focal_length_px};
}

double EstimateDatabasePoseNoise(const std::vector<View>& views, const std::vector<ViewScale>& scales,
                                 const std::vector<Eigen::Matrix<double, 6, 6>>& pose_covariances,
                                 double variance_factor, double expected_noise_px) {
  double freedom = 6 * kNumExpectedViews;
  double squared_sum = freedom * expected_noise_px * expected_noise_px;
  for (size_t view = 0; view < views.size(); ++view) {
    if (!views[view].prior) continue;
    const PosePrior one_px = MakePosePrior(views[view].prior->cam_from_world, 1, scales[view]);
    const PosePriorResidual residual = EvaluatePosePrior(one_px, views[view].cam_from_world);
    const auto spread = residual.jacobian * pose_covariances[view] * residual.jacobian.transpose();
    squared_sum += residual.error.squaredNorm() + variance_factor * spread.trace();
    freedom += 6;
  }
  return std::sqrt(squared_sum / freedom);
}

}  // namespace lazyloc

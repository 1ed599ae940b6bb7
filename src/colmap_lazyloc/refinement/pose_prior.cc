#include "colmap_lazyloc/refinement/pose_prior.h"

#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

constexpr double kNumExpectedFrames = 3;

}  // namespace

PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& frame_from_world) {
  PosePriorResidual residual;
  const Eigen::Matrix3d world_from_frame = frame_from_world.rotation.conjugate().toRotationMatrix();
  residual.error.head<3>() =
      LogSO3(frame_from_world.rotation * prior.frame_from_world.rotation.conjugate()) / prior.rotation_stddev_rad;
  residual.error.tail<3>() =
      (CamInWorld(frame_from_world) - CamInWorld(prior.frame_from_world)) / prior.position_stddev;
  // The jacobian is exact to first order in the rotation's deviation.
  residual.jacobian.setZero();
  residual.jacobian.topLeftCorner<3, 3>().diagonal().setConstant(1 / prior.rotation_stddev_rad);
  residual.jacobian.bottomLeftCorner<3, 3>() =
      -world_from_frame * Hat(frame_from_world.translation) / prior.position_stddev;
  residual.jacobian.bottomRightCorner<3, 3>() = -world_from_frame / prior.position_stddev;
  return residual;
}

std::vector<FrameScale> MeasureFrameScales(const PosedImages& posed, const std::vector<Track>& tracks) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  std::vector<std::vector<double>> focal_lengths_px(posed.frames.size()), distances(posed.frames.size());
  for (const Track& track : tracks) {
    for (const TrackObservation& element : track.observations) {
      const int frame = posed.images[element.image].frame;
      focal_lengths_px[frame].push_back(1 / RadFromPx(element.observation));
      distances[frame].push_back((cams_from_world[element.image] * track.point_in_world).norm());
    }
  }
  std::vector<FrameScale> scales(posed.frames.size());
  for (size_t frame = 0; frame < scales.size(); ++frame) {
    if (distances[frame].empty()) continue;
    scales[frame] = {Median(std::move(focal_lengths_px[frame])), Median(std::move(distances[frame]))};
  }
  return scales;
}

PosePrior MakePosePrior(const Rigid3d& frame_from_world, double noise_px, const FrameScale& scale) {
  return {frame_from_world, noise_px / scale.focal_length_px, noise_px * scale.distance / scale.focal_length_px};
}

double EstimateDatabasePoseNoise(const std::vector<Frame>& frames, const std::vector<FrameScale>& scales,
                                 const std::vector<Eigen::Matrix<double, 6, 6>>& frame_covariances,
                                 double variance_factor, double expected_noise_px) {
  double num_parameters = 6 * kNumExpectedFrames;
  double squared_sum = num_parameters * expected_noise_px * expected_noise_px;
  for (size_t frame = 0; frame < frames.size(); ++frame) {
    if (!frames[frame].prior) continue;
    const PosePrior one_px = MakePosePrior(frames[frame].prior->frame_from_world, 1, scales[frame]);
    const PosePriorResidual residual = EvaluatePosePrior(one_px, frames[frame].frame_from_world);
    const auto spread = residual.jacobian * frame_covariances[frame] * residual.jacobian.transpose();
    squared_sum += residual.error.squaredNorm() + variance_factor * spread.trace();
    num_parameters += 6;
  }
  return std::sqrt(squared_sum / num_parameters);
}

}  // namespace lazyloc

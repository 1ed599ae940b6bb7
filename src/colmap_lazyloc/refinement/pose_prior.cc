#include "colmap_lazyloc/refinement/pose_prior.h"

#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {

PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& frame_from_world) {
  PosePriorResidual residual;
  const Eigen::Matrix3d world_from_frame = frame_from_world.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d turn = LogSO3(prior.frame_from_world.rotation.conjugate() * frame_from_world.rotation);
  residual.error.head<3>() = turn / prior.rotation_stddev_rad;
  residual.error.tail<3>() =
      (CamInWorld(frame_from_world) - CamInWorld(prior.frame_from_world)) / prior.position_stddev;
  // Neglects terms of second order in the rotation's deviation.
  residual.jacobian.setZero();
  residual.jacobian.topLeftCorner<3, 3>() =
      (world_from_frame + 0.5 * Hat(turn) * world_from_frame) / prior.rotation_stddev_rad;
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
    scales[frame] = {Median(std::move(focal_lengths_px[frame])), HarmonicMean(distances[frame])};
  }
  return scales;
}

PosePrior MakePosePrior(const Rigid3d& frame_from_world, double noise_px, const FrameScale& scale) {
  return {frame_from_world, noise_px / scale.focal_length_px, noise_px * scale.distance / scale.focal_length_px};
}

}  // namespace lazyloc

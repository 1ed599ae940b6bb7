#include "colmap_lazyloc/refinement/bundle_problem.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Sorts a track's observations by their frames, because a block of the camera system is stored by the larger index. The
// images of a frame need not stand together.
void SortByFrame(size_t begin, std::vector<FreeObservation>* free) {
  const auto first = free->begin() + static_cast<std::ptrdiff_t>(begin);
  const auto by_frame = [](const FreeObservation& a, const FreeObservation& b) { return a.frame < b.frame; };
  if (!std::is_sorted(first, free->end(), by_frame)) std::stable_sort(first, free->end(), by_frame);
}

}  // namespace

BundleProblem::BundleProblem(const PosedImages& posed, const std::vector<Track>& tracks)
    : index_of_frame(posed.frames.size(), -1) {
  for (size_t i = 0; i < posed.frames.size(); ++i) {
    const Frame& frame = posed.frames[i];
    if (IsConstant(frame)) continue;
    index_of_frame[i] = AddPose(frame.frame_from_world, frame.prior ? &*frame.prior : nullptr);
    if (frame.has_free_scale) frames.back().kind = BlockKind::POSE_AND_RIG_SCALE;
  }
  AddCalibrations(posed);
  AddDepthMaps(posed);
  AddPriors(posed);
  AddQueryPriors(posed);
  for (size_t i = 0; i < posed.images.size(); ++i) {
    const Image& image = posed.images[i];
    if (!image.log_focal_factor) continue;
    const int frame = index_of_image[i];
    LAZYLOC_CHECK(frame >= 0 && frames[frame].kind == BlockKind::POSE);
    frames[frame].log_factor = *image.log_focal_factor;
    frames[frame].kind = BlockKind::POSE_AND_FOCAL_LENGTH;
  }
  size_t num_observations = 0;
  double min_noise_ratio = std::numeric_limits<double>::infinity();
  for (const Track& track : tracks) {
    num_observations += track.observations.size();
    min_noise_ratio = std::min(min_noise_ratio, track.noise_ratio);
  }
  free.reserve(num_observations);
  for (const Track& track : tracks) {
    const size_t fixed_begin = fixed.size(), free_begin = free.size();
    for (size_t k = 0; k < track.observations.size(); ++k) {
      const TrackObservation& element = track.observations[k];
      const Image& image = posed.images[element.image];
      const double residual_from_px = ResidualFromPx(image, track);
      const LinearProjection projection =
          ProjectionInWorld(element.observation, cams_from_axes[element.image]).Scaled(residual_from_px);
      const int frame = index_of_image[element.image];
      if (frame < 0) {
        fixed.push_back(projection);
        continue;
      }
      const double factor_from_px = image.log_focal_factor ? residual_from_px : 0;  // zero: no such parameter
      free.push_back({frame, projection, factor_from_px * element.observation.px_from_log_focal, static_cast<int>(k)});
    }
    SortByFrame(free_begin, &free);
    AddDepths(posed, track, track.noise_ratio / min_noise_ratio);
    fixed_range.push_back({fixed_begin, fixed.size()});
    free_range.push_back({free_begin, free.size()});
    points.push_back(track.point_in_world);
  }
}

void BundleProblem::AddPriors(const PosedImages& posed) {
  std::vector<bool> is_grouped(frames.size(), false);
  for (const PriorGroup& group : posed.prior_groups) {
    BundlePriors& of_group = priors.emplace_back();
    of_group.precision = ComputePriorPrecision(group);
    for (const int frame : group.frames) {
      LAZYLOC_CHECK(posed.frames[frame].prior.has_value());
      of_group.frames.push_back(index_of_frame[frame]);
      is_grouped[of_group.frames.back()] = true;
    }
  }
  for (size_t i = 0; i < frames.size(); ++i) {
    if (!pose_priors[i] || is_grouped[i]) continue;
    const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(1, 1);
    priors.push_back({{static_cast<int>(i)}, {one, one}});
  }
}

void BundleProblem::AddDepthMaps(const PosedImages& posed) {
  for (const Image& image : posed.images) {
    index_of_depth_map.push_back(-1);
    if (!image.depth_scale) continue;
    index_of_depth_map.back() = AddPose({}, nullptr);
    frames.back().kind = BlockKind::DEPTH_SCALE;
    frames.back().log_factor = image.depth_scale->log_scale;
    depth_maps.push_back(
        {index_of_depth_map.back(), image.depth_scale->stated_log_scale, image.depth_scale->log_scale_stddev});
  }
}

// Adds the depths of a track's point after its other observations, because the scales of the maps have larger indices.
// noise_ratio: how much less certain its keypoints are than those of the best tracks. Its depths are too, because a
// false match has a false depth; else they would outweigh the keypoints.
void BundleProblem::AddDepths(const PosedImages& posed, const Track& track, double noise_ratio) {
  for (const TrackObservation& element : track.observations) {
    const int map = index_of_depth_map[element.image];
    if (map < 0 || !(element.depth > 0)) continue;
    DepthObservation depth;
    depth.frame = index_of_image[element.image];
    const Rigid3d& cam_from_axes = cams_from_axes[element.image];
    depth.axis = cam_from_axes.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    depth.offset = cam_from_axes.translation.z();
    depth.log_depth = std::log(element.depth);
    depth.residual_from_log = 1 / (noise_ratio * posed.images[element.image].depth_scale->log_depth_stddev);
    FreeObservation coupling{};
    coupling.frame = map;
    coupling.depth = static_cast<int>(depths.size());
    depths.push_back(depth);
    free.push_back(coupling);
  }
}

void BundleProblem::AddQueryPriors(const PosedImages& posed) {
  for (const ImagePrior& prior : posed.query_priors) {
    const int index = index_of_image[prior.image];
    LAZYLOC_CHECK(index >= 0);
    query_priors.push_back({index, cams_from_axes[prior.image], prior.prior});
  }
}

int BundleProblem::AddPose(const Rigid3d& pose, const PosePrior* prior) {
  frames.emplace_back().MoveTo(pose);
  pose_priors.push_back(prior);
  return static_cast<int>(frames.size()) - 1;
}

void BundleProblem::AddCalibrations(const PosedImages& posed) {
  for (const Calibration& calibration : posed.calibrations) {
    index_of_calibration.push_back(calibration.prior ? AddPose(calibration.cam_from_frame, &*calibration.prior) : -1);
  }
  for (size_t i = 0; i < posed.images.size(); ++i) {
    const Image& image = posed.images[i];
    const int frame = index_of_frame[image.frame];
    const int calibration = image.calibration < 0 ? -1 : index_of_calibration[image.calibration];
    const Rigid3d cam_from_world = CamFromWorld(posed, static_cast<int>(i));
    index_of_image.push_back(frame);
    cams_from_axes.push_back(frame < 0 ? cam_from_world : image.cam_from_frame);
    if (frame < 0 || calibration < 0) continue;
    index_of_image.back() = AddPose(cam_from_world, nullptr);
    cams_from_axes.back() = Rigid3d();
    flexes.push_back({frame, calibration, index_of_image.back(), &posed.calibrations[image.calibration]});
  }
}

}  // namespace lazyloc

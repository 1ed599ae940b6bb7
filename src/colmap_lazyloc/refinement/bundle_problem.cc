#include "colmap_lazyloc/refinement/bundle_problem.h"

#include <algorithm>

#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

BundleFrame MakeBundleFrame(const Frame& frame) {
  BundleFrame bundle_frame;
  bundle_frame.MoveTo(frame.frame_from_world);
  bundle_frame.factor_is_scale = frame.has_free_scale;
  return bundle_frame;
}

// Returns the projection of points in the frame's axes. Most images have these axes: they need no rotation.
LinearProjection ProjectionInFrame(const Observation& observation, const Image& image, bool has_frame_axes) {
  return has_frame_axes ? ProjectionInCam(observation) : ProjectionInWorld(observation, image.cam_from_frame);
}

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
    index_of_frame[i] = static_cast<int>(frames.size());
    given.push_back(&frame);
    frames.push_back(MakeBundleFrame(frame));
    has_factor.push_back(frame.has_free_scale);
  }
  std::vector<bool> has_frame_axes;
  for (const Image& image : posed.images) {
    has_frame_axes.push_back(HasFrameAxes(image));
    if (!image.log_focal_factor) continue;
    const int frame = index_of_frame[image.frame];
    LAZYLOC_CHECK(frame >= 0 && !has_factor[frame]);
    frames[frame].log_factor = *image.log_focal_factor;
    has_factor[frame] = true;
  }
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  size_t num_observations = 0;
  for (const Track& track : tracks) num_observations += track.observations.size();
  free.reserve(num_observations);
  for (const Track& track : tracks) {
    const size_t fixed_begin = fixed.size(), free_begin = free.size();
    for (const TrackObservation& element : track.observations) {
      const Image& image = posed.images[element.image];
      const double residual_from_px = ResidualFromPx(image, track);
      const int frame = index_of_frame[image.frame];
      if (frame < 0) {
        fixed.push_back(
            ProjectionInWorld(element.observation, cams_from_world[element.image]).Scaled(residual_from_px));
        continue;
      }
      const LinearProjection projection = ProjectionInFrame(element.observation, image, has_frame_axes[element.image]);
      const double factor_from_px = image.log_focal_factor ? residual_from_px : 0;  // zero: no such parameter
      free.push_back(
          {frame, projection.Scaled(residual_from_px), factor_from_px * element.observation.px_from_log_focal});
    }
    SortByFrame(free_begin, &free);
    fixed_range.push_back({fixed_begin, fixed.size()});
    free_range.push_back({free_begin, free.size()});
    points.push_back(track.point_in_world);
  }
}

}  // namespace lazyloc

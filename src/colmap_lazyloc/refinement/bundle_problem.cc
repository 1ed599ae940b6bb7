#include "colmap_lazyloc/refinement/bundle_problem.h"

#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {

BundleProblem::BundleProblem(const std::vector<View>& all_views, const std::vector<Track>& tracks)
    : camera_of_view(all_views.size(), -1) {
  for (size_t i = 0; i < all_views.size(); ++i) {
    const View& view = all_views[i];
    if (IsConstant(view)) continue;
    if (view.rig_link) {
      camera_of_view[i] = camera_of_view[view.rig_link->reference];
      continue;
    }
    camera_of_view[i] = static_cast<int>(views.size());
    views.push_back(&view);
    cameras.emplace_back(view);
  }
  size_t num_observations = 0;
  for (const Track& track : tracks) num_observations += track.observations.size();
  free.reserve(num_observations);
  for (const Track& track : tracks) {
    const size_t fixed_begin = fixed.size(), free_begin = free.size();
    for (const TrackObservation& element : track.observations) {
      const View& view = all_views[element.view];
      const double residual_from_px = ResidualFromPx(view, track);
      if (IsConstant(view)) {
        fixed.push_back(ProjectionInWorld(element.observation, view.cam_from_world).Scaled(residual_from_px));
        continue;
      }
      const LinearProjection projection =
          view.rig_link ? ProjectionInWorld(element.observation, view.rig_link->cam_from_reference)
                        : ProjectionInCam(element.observation);
      free.push_back({camera_of_view[element.view], projection.Scaled(residual_from_px),
                      residual_from_px * element.observation.px_from_log_focal});
    }
    fixed_range.push_back({fixed_begin, fixed.size()});
    free_range.push_back({free_begin, free.size()});
    points.push_back(track.point_in_world);
  }
}

}  // namespace lazyloc

#include <algorithm>

#include "colmap_lazyloc/bridge/triangulation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/structure/point_finder.h"

namespace lazyloc {
namespace {

// Finds points by COLMAP's robust multi-view triangulation.
class ColmapPointFinder : public PointFinder {
 public:
  ColmapPointFinder(const TrackEvaluator& evaluator, const TrackTriangulationOptions& options)
      : evaluator_(evaluator), options_(options) {}

  std::optional<Eigen::Vector3d> FindPoint(const std::vector<TrackObservation>& observations,
                                           const ObservationIndices& used) override {
    const std::optional<Triangulation> found = Triangulate(observations, used, options_.max_query_error_sigma);
    if (!found || !std::all_of(found->is_inlier.begin(), found->is_inlier.end(), [](bool is) { return is; })) {
      return std::nullopt;
    }
    return found->point_in_world;
  }

  std::optional<Eigen::Vector3d> FindConsensus(const std::vector<TrackObservation>& observations,
                                               ObservationIndices* used) override {
    const std::optional<Triangulation> found = Triangulate(observations, *used, kMaxDatabaseErrorSigma);
    if (!found) return std::nullopt;
    size_t num_kept = 0;
    for (size_t k = 0; k < used->size(); ++k) {
      const size_t i = (*used)[k];
      const bool agrees =
          found->is_inlier[k] && evaluator_.Fits(observations[i], found->point_in_world, kMaxDatabaseErrorSigma);
      if (agrees) (*used)[num_kept++] = i;
    }
    used->resize(num_kept);
    return num_kept >= 2 ? std::make_optional(found->point_in_world) : std::nullopt;
  }

 private:
  // COLMAP takes one angle for all observations: that of the noisiest.
  std::optional<Triangulation> Triangulate(const std::vector<TrackObservation>& observations,
                                           const ObservationIndices& used, double max_error_sigma) const {
    std::vector<Rigid3d> cams_from_world;
    std::vector<Eigen::Vector3d> rays_in_cam;
    double max_error_rad = 0;
    for (const size_t i : used) {
      const TrackObservation& element = observations[i];
      cams_from_world.push_back(evaluator_.CamFromWorldOf(element));
      rays_in_cam.push_back(element.observation.ray_in_cam);
      max_error_rad = std::max(max_error_rad,
                               max_error_sigma * evaluator_.ImageOf(element).noise_px * RadFromPx(element.observation));
    }
    return TriangulateTrack(cams_from_world, rays_in_cam, max_error_rad,
                            DegToRad(options_.min_triangulation_angle_deg));
  }

  const TrackEvaluator& evaluator_;
  const TrackTriangulationOptions& options_;
};

}  // namespace

std::unique_ptr<PointFinder> MakeColmapPointFinder(const TrackEvaluator& evaluator,
                                                   const TrackTriangulationOptions& options) {
  return std::make_unique<ColmapPointFinder>(evaluator, options);
}

}  // namespace lazyloc

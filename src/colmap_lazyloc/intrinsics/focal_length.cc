#include "colmap_lazyloc/intrinsics/focal_length.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/initialization/start_selection.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/scene/refs.h"

namespace lazyloc {
namespace {

// The focal length is searched from the given one over this factor to the one times it.
constexpr double kMaxFocalFactor = 3;
// Number of factors on each side of 1. Neighbours differ by 8 %, which adjustment corrects.
constexpr int kNumSteps = 14;

}  // namespace

bool HasFocalLength(const Camera& camera) { return !SameIntrinsics(WithFocalFactor(camera, 2), camera); }

bool IsFocalLengthUnknown(const LocalizationProblem& problem, const LocalizerOptions& options) {
  if (options.intrinsics == IntrinsicsMode::GIVEN || !HasFocalLength(problem.query_camera)) return false;
  return options.intrinsics == IntrinsicsMode::REFINE || !IsOfThisCamera(problem.intrinsics_origin);
}

FocalLengthAndPose ChooseFocalLengthAndPose(const Layout& layout, const QueryCamera& camera,
                                            const std::vector<Track>& tracks_from_database,
                                            const LocalizerOptions& options) {
  const double max_error_px = kMaxStartErrorPx;
  const uint32_t seed = SeedFromNames(layout.names[0], "", options.seed);
  const double num_tracks = static_cast<double>(std::max<size_t>(tracks_from_database.size(), 1));
  const TrackRefs no_other_tracks;  // not used, because any focal length fits an epipolar line
  double best_score = 0;
  FocalLengthAndPose best;
  for (int i = 0; i <= 2 * kNumSteps; ++i) {
    const int step = i % 2 == 0 ? i / 2 : -(i + 1) / 2;  // from the given focal length outwards
    const double factor = std::pow(kMaxFocalFactor, static_cast<double>(step) / kNumSteps);
    QueryCamera scaled = camera;
    scaled.ScaleFocalLength(factor);
    const std::vector<Track> tracks = scaled.Observe(tracks_from_database);
    const TrackRefs from_database = Refs(tracks);
    // Half the inliers of the best so far, because RANSAC need not search for a pose that does not win.
    const double min_inlier_ratio = std::max(0.1, 0.5 * best_score / num_tracks);
    const StartProblem problem{layout.given, from_database, no_other_tracks, max_error_px, min_inlier_ratio};
    const std::optional<Rigid3d> pose = AbsolutePoseStart(problem, seed);
    if (!pose) continue;
    const double score = ScoreStart(problem, *pose);
    if (score <= best_score) continue;
    best_score = score;
    best = {factor, *pose};
  }
  if (best_score > 0) return best;
  throw Failure{QueryStatus::TOO_FEW_TRACKS, "no focal length explains the " +
                                                 std::to_string(tracks_from_database.size()) +
                                                 " points that two or more database images triangulate"};
}

}  // namespace lazyloc

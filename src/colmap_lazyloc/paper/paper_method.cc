#include "colmap_lazyloc/paper/paper_method.h"

#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/paper/colmap_triangulation.h"
#include "colmap_lazyloc/refinement/ceres_bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {
namespace {

void KeepAgreeingPairs(Averaged* averaged) {
  PairRefs agreeing;
  std::vector<RelativeDirection> directions;
  for (size_t i = 0; i < averaged->pairs.size(); ++i) {
    const PairGeometry& pair = *averaged->pairs[i];
    const Eigen::Quaterniond query = CamFromWorld(averaged->posed, pair.query).rotation,
                             other = CamFromWorld(averaged->posed, pair.other).rotation;
    if (AngularDistanceRad(query, pair.query_from_other.rotation * other) > DegToRad(kMaxRotationErrorDeg)) continue;
    agreeing.push_back(&pair);
    directions.push_back(averaged->directions[i]);
  }
  averaged->pairs = std::move(agreeing);
  averaged->directions = std::move(directions);
}

// Removes the observations that the points do not fit, as COLMAP's mapper does after adjustment, and tracks that no
// query or no other image is left to observe.
std::vector<Track> RemoveMisfits(const PosedImages& posed, const std::vector<Track>& tracks) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  std::vector<Track> fitting;
  for (const Track& track : tracks) {
    Track kept = track;
    kept.observations.clear();
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.image] * track.point_in_world;
      if (IsInFront(element.observation, point_in_cam) &&
          ReprojectionError(element.observation, point_in_cam).norm() <= kMaxPaperErrorPx) {
        kept.observations.push_back(element);
      }
    }
    if (kept.observations.size() < 2 || posed.IsDatabase(kept.observations.front().image)) continue;
    fitting.push_back(std::move(kept));
  }
  return fitting;
}

// Throws Failure for frames with too few tracks.
void CheckNumTracks(const Layout& layout, const std::vector<Track>& tracks, size_t num_candidates) {
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, tracks);
  CheckFrames(layout.num_query_frames, QueryStatus::TOO_FEW_TRACKS, [&](int frame) {
    if (static_cast<int>(tracks_of[frame].size()) >= kMinNumTracks) return Reason();
    return Reason(std::to_string(tracks_of[frame].size()) + " of " + std::to_string(num_candidates) +
                  " tracks can be triangulated; " + std::to_string(kMinNumTracks) + " are needed");
  });
}

// Adds the covariances at the minimum, by the equations of our own adjustment, which takes no step from there.
void AddCovariances(Refined* refined) {
  BundleAdjustmentOptions at_minimum;
  at_minimum.max_num_iterations = 0;
  const StageSummary summary = refined->adjustment.summary;
  refined->adjustment = AdjustBundle(refined->adjustment.posed, std::move(refined->adjustment.tracks), at_minimum);
  if (!refined->adjustment.summary.success) {
    throw Failure{QueryStatus::DIVERGED, "bundle adjustment has no covariance: " + refined->adjustment.summary.message};
  }
  refined->adjustment.summary = summary;
  refined->variance_factor =
      VarianceFactor(refined->adjustment.posed, refined->adjustment.tracks, RobustLoss(at_minimum.loss_scale_sigma));
}

}  // namespace

PaperPose LocalizeByPaper(const QueryGroup& group, const Layout& layout, const PairEstimates& estimates,
                          const LocalizerOptions& options, StageTimer::Seconds* seconds) {
  PaperPose result;
  result.averaged = AverageAgreeing(layout, estimates.pairs, options, seconds);
  result.refined = AdjustByPaper(group, layout, result.averaged, seconds);
  return result;
}

Averaged AverageAgreeing(const Layout& layout, const std::vector<PairGeometry>& pairs, const LocalizerOptions& options,
                         StageTimer::Seconds* seconds, const AveragingMethods& methods) {
  Averaged averaged = AverageMotion(layout, pairs, options, seconds, methods);
  if (averaged.failure) throw Failure(*averaged.failure);
  KeepAgreeingPairs(&averaged);
  return averaged;
}

Refined AdjustByPaper(const QueryGroup& group, const Layout& layout, const Averaged& averaged,
                      StageTimer::Seconds* seconds) {
  PosedImages start = averaged.posed;
  for (Image& image : start.images) {
    image.noise_px = kPaperNoisePx;
    image.depth_scale.reset();
  }
  std::vector<Track> candidates =
      Timed("tracks", seconds, [&] { return CollectTracks(group, layout, averaged.pairs).all; });
  const size_t num_candidates = candidates.size();
  const std::vector<Track> tracks =
      Timed("triangulation", seconds, [&] { return TriangulateWithColmap(start, std::move(candidates)); });
  CheckNumTracks(layout, tracks, num_candidates);
  CeresAdjustment adjusted = Timed("adjustment", seconds, [&] { return AdjustWithCeres(start, tracks, {}); });
  if (!adjusted.summary.success) {
    throw Failure{QueryStatus::DIVERGED, "bundle adjustment failed: " + adjusted.summary.message};
  }
  Refined refined;
  refined.adjustment.summary = adjusted.summary;
  refined.adjustment.posed = std::move(adjusted.posed);
  refined.adjustment.tracks = RemoveMisfits(refined.adjustment.posed, adjusted.tracks);
  CheckNumTracks(layout, refined.adjustment.tracks, num_candidates);
  refined.rig_errors_px.resize(layout.num_queries);
  Timed("covariance", seconds, [&] { AddCovariances(&refined); });
  return refined;
}

}  // namespace lazyloc

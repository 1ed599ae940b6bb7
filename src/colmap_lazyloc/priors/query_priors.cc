#include "colmap_lazyloc/priors/query_priors.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/noise/viewpoint_errors.h"
#include "colmap_lazyloc/priors/prior_comparison.h"
#include "colmap_lazyloc/priors/prior_fusion.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/refs.h"
#include "colmap_lazyloc/uncertainty/pose_uncertainty.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Minimum distance of points over the standard deviation of a position that is known by a prior alone.
constexpr double kMinDistanceRatio = 1e-6;

// Judges the priors of one query.
class Judge {
 public:
  // reported: the poses with what the database states (RelativeToGivenDatabase), because priors are of what is
  // reported.
  Judge(const Layout& layout, const Refined& refined, const PosedImages& reported, int query, PriorJudgement* judgement)
      : layout_(layout),
        refined_(refined),
        query_(query),
        judgement_(*judgement),
        variance_factor_(std::max(refined.variance_factor, kMinVarianceFactor)),
        pose_(DistributionOf(refined, query, CamFromWorld(reported, query))) {}

  // Judges the priors of a query whose pose the images determine.
  void JudgeObservable() {
    const QueryPrior& given = layout_.priors[query_];
    if (given.position) UsePosition(ComparePosition(*given.position, pose_));
    CompareGravityIfGiven();
    AddUsed();
  }

  // Judges the priors of a single query whose position is unobservable. partial: what the images determine of its pose.
  void JudgeUnobservable(const PartialPose& partial) {
    const QueryPrior& given = layout_.priors[query_];
    if (!given.position) return;  // gravity does not fix a position
    Eigen::Vector3d place;
    if (partial.bearing) {
      const Bearing& bearing = *partial.bearing;
      const PlaceOnRay on_ray =
          CompareWithRay(*given.position, {CentreOf(bearing.database_name), bearing.dir_database_to_query_in_world},
                         bearing.stddev_rad);
      UsePosition(on_ray.comparison);
      place = on_ray.place_in_world;
    } else {
      UsePosition(ComparePosition(*given.position, pose_));
      place = MostProbablePlace(*given.position);
    }
    if (!used_.position) return;
    judgement_.results[query_].position->fixes = PriorRole::DISTANCE;
    judgement_.unobservable_line = LineThrough(partial, *used_.position);
    CompareGravityIfGiven();
    AddUsed();
    judgement_.start = CamFromWorld(pose_.cam_from_world.rotation, place);
  }

 private:
  void UsePosition(const PriorComparison& comparison) {
    used_.position =
        UsedPrior(*layout_.priors[query_].position, comparison, &judgement_.results[query_].position, variance_factor_);
    if (!used_.position) return;
    // Moves the prior to where adjustment has the image.
    used_.position->position +=
        CamInWorld(CamFromWorld(refined_.adjustment.posed, query_)) - CamInWorld(pose_.cam_from_world);
  }

  void CompareGravityIfGiven() {
    const std::optional<GravityPrior>& gravity = layout_.priors[query_].gravity;
    if (!gravity) return;
    const PriorComparison comparison =
        CompareGravity(*gravity, pose_.cam_from_world.rotation, pose_.RotationCovariance());
    used_.gravity = UsedPrior(*gravity, comparison, &judgement_.results[query_].gravity, variance_factor_);
  }

  void AddUsed() {
    if (used_.position || used_.gravity) judgement_.used.push_back({query_, used_});
  }

  // Returns the line along which the position is unobservable: that of the bearing, or the least certain axis.
  UnobservableLine LineThrough(const PartialPose& partial, const PositionPrior& used) const {
    const Eigen::Vector3d direction =
        partial.bearing ? partial.bearing->dir_database_to_query_in_world : pose_.Spread().weakest_direction_in_world;
    const double information = direction.dot(used.covariance.ldlt().solve(direction));
    return {direction, variance_factor_ / information};
  }

  Eigen::Vector3d CentreOf(const std::string& database_name) const {
    const auto name = std::find(layout_.names.begin() + layout_.num_queries, layout_.names.end(), database_name);
    return CamInWorld(CamFromWorld(layout_.given, static_cast<int>(name - layout_.names.begin())));
  }

  // Returns the position by the images and the prior together.
  Eigen::Vector3d MostProbablePlace(const PositionPrior& prior) const {
    const Eigen::Vector3d centre = CamInWorld(pose_.cam_from_world);
    const Eigen::Matrix3d covariance = pose_.PositionCovariance();
    const Eigen::Matrix3d sum = covariance + prior.covariance;
    return centre + covariance * sum.ldlt().solve(prior.position - centre);
  }

  const Layout& layout_;
  const Refined& refined_;
  const int query_;
  PriorJudgement& judgement_;
  const double variance_factor_;  // by which the covariance of the adjustment is multiplied
  const PoseDistribution pose_;   // by the images
  QueryPrior used_;
};

}  // namespace

PriorJudgement JudgePriors(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                           const LocalizerOptions& options) {
  PriorJudgement judgement;
  for (const QueryPrior& prior : layout.priors) judgement.results.push_back(UntestedPriors(prior));
  const PosedImages reported = RelativeToGivenDatabase(layout, refined.adjustment.posed);
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  for (int query = 0; query < layout.num_queries; ++query) {
    if (!layout.priors[query].position && !layout.priors[query].gravity) continue;
    const int frame = layout.FrameOf(query);
    // Compares nothing with a pose that has too few tracks, because it will be refused.
    if (static_cast<int>(tracks_of[frame].size()) < kMinNumTracks) continue;
    const AdjustedFrame adjusted{layout,
                                 pairs,
                                 refined.adjustment,
                                 frame,
                                 tracks_of[frame],
                                 refined.variance_factor,
                                 refined.has_one_orientation};
    Judge judge(layout, refined, reported, query, &judgement);
    if (!IsPositionUnobservable(adjusted, options)) {
      if (!IsFused(layout, refined.adjustment.posed, query)) judge.JudgeObservable();
    } else if (layout.num_queries == 1) {
      const Failure failure = UnobservablePositionFailure(adjusted);
      const auto partial = failure.partial_poses.find(query);
      if (partial != failure.partial_poses.end()) judge.JudgeUnobservable(partial->second);
    }
  }
  return judgement;
}

Refined AdjustWithPriors(const std::vector<ImagePrior>& priors, const LocalizerOptions& options, Refined refined) {
  if (priors.empty()) return refined;
  PosedImages posed = refined.adjustment.posed;
  posed.query_priors = priors;
  std::optional<QueryCamera> camera = refined.camera;
  BundleAdjustmentResult adjustment =
      camera ? camera->Adjust(std::move(posed), refined.adjustment.tracks, options.bundle_adjustment)
             : AdjustBundle(posed, refined.adjustment.tracks, options.bundle_adjustment);
  if (!adjustment.summary.success) return refined;
  refined.adjustment = std::move(adjustment);
  refined.camera = std::move(camera);
  return WithLimitedVarianceFactor(std::move(refined));
}

Refined WithLimitedVarianceFactor(Refined refined) {
  refined.variance_factor = std::max(refined.variance_factor, kMinVarianceFactor);
  refined.SetMissingVariances();
  return refined;
}

bool AreReconciled(const Refined& refined) {
  const PosedImages& posed = refined.adjustment.posed;
  return std::all_of(posed.query_priors.begin(), posed.query_priors.end(), [&](const ImagePrior& used) {
    if (!used.prior.position) return true;
    const PositionPrior prior = Scaled(*used.prior.position, refined.variance_factor);
    const Rigid3d pose = CamFromWorld(posed, used.image);
    const Eigen::Vector3d deviation = prior.position - CamInWorld(pose);
    if (!(deviation.dot(prior.covariance.ldlt().solve(deviation)) <= kContradictionOfThree)) return false;
    return MedianDistance(pose, Refs(refined.adjustment.tracks)) >
           kMinDistanceRatio * std::sqrt(prior.covariance.trace());
  });
}

}  // namespace lazyloc

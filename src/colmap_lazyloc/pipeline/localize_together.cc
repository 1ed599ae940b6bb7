#include "colmap_lazyloc/pipeline/localize_together.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/depth_maps_in_use.h"
#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/intrinsics_check.h"
#include "colmap_lazyloc/pipeline/pose_evidence.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/pipeline/prior_comparison.h"
#include "colmap_lazyloc/pipeline/prior_fusion.h"
#include "colmap_lazyloc/pipeline/pure_rotation.h"
#include "colmap_lazyloc/pipeline/query_priors.h"
#include "colmap_lazyloc/pipeline/refinement_with_priors.h"
#include "colmap_lazyloc/pipeline/refinement_without_tracks.h"
#include "colmap_lazyloc/pipeline/report.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/query_prior_residual.h"

namespace lazyloc {
namespace {

// Throws Failure for frames without keypoints or without matches.
void CheckInput(const QueryGroup& group) {
  const int num_frames = static_cast<int>(group.frame_names.size());
  std::vector<bool> has_keypoints(num_frames, false), has_pairs(num_frames, false);
  for (const QueryImage& query : group.images) {
    if (!query.problem.query_keypoints.empty()) has_keypoints[query.frame] = true;
    if (!query.problem.pairs.empty()) has_pairs[query.frame] = true;
  }
  for (const QueryPair& pair : group.query_pairs) {
    // A frame may be linked to the database by another frame.
    const int frame = group.images[pair.query].frame, other_frame = group.images[pair.other].frame;
    if (num_frames > 1) has_pairs[frame] = has_pairs[other_frame] = true;
  }
  CheckFrames(num_frames, QueryStatus::NO_FEATURES,
              [&](int frame) { return has_keypoints[frame] ? Reason() : Reason("the query has no keypoints"); });
  CheckFrames(num_frames, QueryStatus::NO_PAIRS, [&](int frame) {
    return has_pairs[frame] ? Reason() : Reason("no posed database image shares matches with the query");
  });
}

// Runs a pipeline that adds what it finds to a report, and adds its failure.
template <typename Pipeline>
Outcome Run(const QueryGroup& group, const Pipeline& pipeline) {
  Report report(group);
  Outcome outcome;
  try {
    CheckInput(group);
    pipeline(&report);
  } catch (const Failure& failure) {
    report.AddFailure(failure);
    outcome.failed_frames = failure.frames;
    if (failure.frames.empty()) {
      outcome.failed_frames.resize(group.frame_names.size());
      std::iota(outcome.failed_frames.begin(), outcome.failed_frames.end(), 0);
    }
  }
  outcome.results = std::move(report).Finish();
  return outcome;
}

// Runs a stage and adds its wall time to the report.
template <typename Stage>
auto Timed(const char* name, Report* report, const Stage& stage) {
  const StageTimer timer(name, report->Seconds());
  return stage();
}

bool HaveNeighbours(const QueryGroup& group) {
  const auto has_neighbours = [](const ImagePair& pair) { return !pair.neighbours.empty(); };
  return std::any_of(group.images.begin(), group.images.end(), [&](const QueryImage& query) {
    return std::any_of(query.problem.pairs.begin(), query.problem.pairs.end(), has_neighbours);
  });
}

// Makes the layout for pipelines that correct database poses.
Layout MakeLayoutWithPoseErrors(const QueryGroup& group, const LocalizerOptions& options, Report* report) {
  Layout layout = MakeLayout(group);
  if (HaveNeighbours(group)) {
    layout.expected_pose_errors = Timed("database_poses", report, [&] { return MeasurePoseErrors(group, options); });
  } else {
    layout.expected_pose_errors.assign(layout.num_query_frames, ExpectPoseErrors(options));
  }
  report->AddPoseErrors(layout);
  return layout;
}

// Takes contradicted intrinsics for unobservable if depths or a prior alone fix the distance: their errors look like
// those of intrinsics, and a single image hardly tells the focal length.
void IgnoreContradictionsOfEvidence(const Layout& layout, const Refined& refined, const LocalizerOptions& options,
                                    std::vector<IntrinsicsResult>* intrinsics) {
  if (!layout.has_depths && !refined.open_line) return;
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, adjustment.tracks);
  for (int query = 0; query < layout.num_queries; ++query) {
    IntrinsicsResult& result = (*intrinsics)[query];
    if (result.verdict != IntrinsicsVerdict::CONTRADICTED) continue;
    if (!refined.open_line && !FixDistance(adjustment.posed, tracks_of[layout.FrameOf(query)], options)) continue;
    result.verdict = IntrinsicsVerdict::UNOBSERVABLE;
    result.contradiction.clear();
  }
}

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Adds a prior of gravity to a rotation that does not contradict it.
void UseGravity(GravityPrior gravity, PriorResult* result, RotationFit* fit) {
  gravity.stddev_rad *= std::sqrt(CompareGravity(gravity, fit->cam_from_world_rotation, fit->covariance, result));
  if (result->verdict != PriorVerdict::USED) return;
  const QueryPriorResidual residual = EvaluateGravityPrior(gravity, {}, {fit->cam_from_world_rotation, {}});
  const Eigen::Matrix3d by_turn = residual.jacobian.leftCols<3>();
  fit->covariance = (fit->covariance.inverse() + by_turn.transpose() * by_turn).inverse().eval();
  const Eigen::Vector3d turn = -fit->covariance * by_turn.transpose() * residual.error;
  fit->cam_from_world_rotation = ExpSO3(turn) * fit->cam_from_world_rotation;
}

// What the stages up to the refinement find. pairs: those in use.
struct Found {
  const QueryGroup& group;
  const Layout& layout;
  const PairEstimates& estimates;
  const PairRefs& pairs;
  const Refined& refined;
  std::vector<QueryPriorResult> priors;
};

// Adds the refined poses with their uncertainties, intrinsics and confidence, and returns the intrinsics. camera: of a
// query whose focal length was estimated; else null.
std::vector<IntrinsicsResult> AddPoses(const Found& found, const LocalizerOptions& options, Report* report,
                                       const QueryCamera* camera = nullptr) {
  const Layout& layout = found.layout;
  const Refined& refined = found.refined;
  CheckedIntrinsics checked = Timed("covariance", report, [&] {
    return CheckIntrinsics(found.group, layout, refined, EstimateUncertainties(layout, found.pairs, refined, options),
                           options, camera);
  });
  if (HavePriors(layout)) {
    std::vector<QueryPriorResult> priors = found.priors;
    Timed("priors", report, [&] { FusePriors(layout, &priors, &checked); });
    report->AddPriors(priors);
  }
  IgnoreContradictionsOfEvidence(layout, refined, options, &checked.results);
  report->AddIntrinsics(checked.results);
  report->AddCameras(checked.cameras);
  report->AddUncertainties(checked.uncertainties);
  const std::vector<PoseEvidence> evidence = Timed("confidence", report, [&] {
    return MeasureEvidence(layout, found.estimates, /*has_relative_poses=*/camera == nullptr, refined,
                           checked.uncertainties);
  });
  report->AddEvidence(layout, evidence, options.min_confidence);
  report->AddPoses(layout, checked.posed);
  report->AddRefined(layout, refined);
  return checked.results;
}

// Returns what motion averaging gives; without it, all pairs, so that other starts are tried.
Averaged Average(const Layout& layout, const PairEstimates& estimates, bool averages_motion,
                 const LocalizerOptions& options, Report* report) {
  if (averages_motion) return AverageMotion(layout, estimates.pairs, options, report->Seconds());
  Averaged averaged{layout.given, {}, {}, Failure{QueryStatus::INCONSISTENT_ROTATIONS, "no start fits the matches"}};
  for (const PairGeometry& pair : estimates.pairs) averaged.pairs.push_back(&pair);
  averaged.directions.resize(averaged.pairs.size());
  return averaged;
}

Outcome Localize(const QueryGroup& group, bool averages_motion, const LocalizerOptions& options) {
  return Run(group, [&](Report* report) {
    const Layout layout = MakeLayoutWithPoseErrors(group, options, report);
    const PairEstimates estimates = EstimatePairs(group, layout, options, report->Seconds());
    report->AddPairs(estimates);
    Averaged averaged = Average(layout, estimates, averages_motion, options, report);
    CandidateTracks candidates =
        Timed("tracks", report, [&] { return CollectTracks(group, layout, averaged.pairs, options); });
    SplitTracks start_tracks = Timed("start", report, [&] {
      return TriangulateFromDatabase(layout.given, candidates.for_start, options.triangulation);
    });
    DepthMapsInUse depths;
    if (layout.has_depths) {
      depths = Timed("depth", report, [&] {
        return UseDepthMaps(group, layout, averaged.pairs, options, &candidates, &start_tracks, &averaged.posed);
      });
      report->AddDepths(depths.results);
    }
    Start start =
        Timed("start", report, [&] { return ChooseStart(layout, averaged, start_tracks, options, depths.starts); });
    report->AddStart(layout, start);
    const auto [refined, priors] =
        RefineWithPriors(layout, averaged.pairs, start_tracks, std::move(candidates), options, report, &start);
    const auto intrinsics = AddPoses({group, layout, estimates, averaged.pairs, refined, priors}, options, report);
    report->AddDepthsOfPoses(layout, refined, options);
    report->AddPairErrors(layout, averaged, refined.adjustment.posed);
    if (options.intrinsics != IntrinsicsMode::GIVEN) RefuseContradicted(layout, intrinsics);
  });
}

}  // namespace

Outcome LocalizeTogether(const QueryGroup& group, const LocalizerOptions& options) {
  return Localize(group, /*averages_motion=*/true, options);
}

Outcome LocalizeByOtherStarts(const QueryGroup& query, const LocalizerOptions& options) {
  return Localize(query, /*averages_motion=*/false, options);
}

Outcome LocalizeWithUnknownFocalLength(const QueryGroup& query, const LocalizerOptions& options) {
  return Run(query, [&](Report* report) {
    const Layout layout = MakeLayoutWithPoseErrors(query, options, report);
    const PairEstimates estimates = FindInliers(query, layout, options, report->Seconds());
    report->AddPairs(estimates);
    PairRefs pairs;
    for (const PairGeometry& pair : estimates.pairs) pairs.push_back(&pair);
    QueryCamera camera(query.images.front().problem);
    CandidateTracks candidates = Timed("tracks", report, [&] { return CollectTracks(query, layout, pairs, options); });
    SplitTracks start_tracks;
    Start start{layout.given, {StartPose::ABSOLUTE_POSE}};
    Timed("start", report, [&] {
      start_tracks = TriangulateFromDatabase(layout.given, candidates.for_start, options.triangulation);
      const FocalLengthAndPose found = ChooseFocalLengthAndPose(layout, camera, start_tracks.from_database, options);
      camera.ScaleFocalLength(found.factor);
      start.posed.frames[0].frame_from_world = found.frame_from_world;
      start.posed.images[0].log_focal_factor = 0;
      start_tracks = {camera.Observe(start_tracks.from_database), camera.Observe(start_tracks.rest)};
      candidates = {camera.Observe(candidates.all), camera.Observe(candidates.for_start)};
    });
    report->AddStart(layout, start);
    Refined refined =
        Refine(layout, start.posed, start_tracks, std::move(candidates), options, report->Seconds(), &camera);
    std::vector<QueryPriorResult> priors = {UntestedPriors(layout.priors[0])};
    if (HavePriors(layout)) {
      const PriorJudgement judgement = JudgePriors(layout, pairs, refined, options);
      if (!judgement.moves_start) {
        priors = judgement.results;
        AdjustWithPriors(judgement.used, options, &camera, &refined);
      }
    }
    AddPoses({query, layout, estimates, pairs, refined, priors}, options, report, &camera);
  });
}

Outcome LocalizeByRotation(const QueryGroup& query, const LocalizerOptions& options) {
  return Run(query, [&](Report* report) {
    const Layout layout = MakeLayout(query);
    const PairEstimates estimates = EstimatePairs(query, layout, options, report->Seconds());
    report->AddPairs(estimates);
    const Averaged averaged = AverageMotion(layout, estimates.pairs, options, report->Seconds());
    const QueryPrior& prior = layout.priors[0];
    QueryPriorResult priors = UntestedPriors(prior);
    RotationFit fit = Timed("rotation", report, [&] { return FitRotation(layout, estimates, averaged); });
    if (prior.gravity) UseGravity(*prior.gravity, &*priors.gravity, &fit);
    priors.position = PriorResult{PriorVerdict::USED, PriorRole::POSITION, kUnknown, kUnknown};
    PosedImages posed = layout.given;
    const Rigid3d pose = CamFromWorld(fit.cam_from_world_rotation, prior.position->position);
    posed.frames[0].frame_from_world = pose;
    const Eigen::Matrix<double, 6, 6> covariance = PoseCovariance(pose, fit.covariance, prior.position->covariance);
    report->AddUncertainties(
        {{CovarianceFromAround(layout.origin, pose.rotation, covariance), ComputePoseSpread(pose, covariance)}});
    report->AddPriors({priors});
    report->AddEvidence(layout, {fit.evidence}, options.min_confidence);
    report->AddPoses(layout, posed);
    report->AddPairErrors(layout, averaged, posed);
  });
}

Outcome LocalizeWithoutTracks(const QueryGroup& query, const LocalizerOptions& options) {
  return Run(query, [&](Report* report) {
    const Layout layout = MakeLayout(query);
    const PairEstimates estimates = EstimatePairs(query, layout, options, report->Seconds());
    report->AddPairs(estimates);
    const Averaged averaged = AverageMotion(layout, estimates.pairs, options, report->Seconds());
    if (averaged.failure) throw Failure(*averaged.failure);
    report->AddStart(layout, {averaged.posed, {StartPose::MOTION_AVERAGING}});
    const PosedImages refined =
        Timed("refinement", report, [&] { return RefineWithoutTracks(query, layout, averaged, options); });
    PoseUncertainty unknown;
    unknown.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
    report->AddUncertainties({unknown});
    report->AddPoses(layout, refined);
    report->AddPairErrors(layout, averaged, refined);
  });
}

}  // namespace lazyloc

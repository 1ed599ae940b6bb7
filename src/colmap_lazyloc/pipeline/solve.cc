#include "colmap_lazyloc/pipeline/solve.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "colmap_lazyloc/initialization/competing_pose.h"
#include "colmap_lazyloc/initialization/motion_averaging.h"
#include "colmap_lazyloc/initialization/pure_rotation.h"
#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/paper/paper_method.h"
#include "colmap_lazyloc/pipeline/choose.h"
#include "colmap_lazyloc/pipeline/refinement_rounds.h"
#include "colmap_lazyloc/priors/plane_orientation.h"
#include "colmap_lazyloc/priors/prior_comparison.h"
#include "colmap_lazyloc/priors/prior_fusion.h"
#include "colmap_lazyloc/priors/query_priors.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/query_prior_residual.h"
#include "colmap_lazyloc/scene/refs.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
// Factor on the minimum triangulation angle beside a single database image.
constexpr double kSmallAngleRatio = 0.2;
// Factor from a first estimate of the focal length to another start, two steps of the search.
constexpr double kOtherStartFactor = 1.2;

bool HavePriors(const Layout& layout) {
  return std::any_of(layout.priors.begin(), layout.priors.end(),
                     [](const QueryPrior& prior) { return prior.position || prior.gravity; });
}

// Returns a rotation with a prior of gravity that it does not contradict.
RotationFit WithGravity(const GravityPrior& gravity, RotationFit fit) {
  const QueryPriorResidual residual = EvaluateGravityPrior(gravity, {}, {fit.cam_from_world_rotation, {}});
  const Eigen::Matrix3d by_turn = residual.jacobian.leftCols<3>();
  fit.covariance = (fit.covariance.inverse() + by_turn.transpose() * by_turn).inverse().eval();
  const Eigen::Vector3d turn = -fit.covariance * by_turn.transpose() * residual.error;
  fit.cam_from_world_rotation = ExpSO3(turn) * fit.cam_from_world_rotation;
  return fit;
}

// Solves one hypothesis; each method fills the solution as far as its stages come.
class Solver {
 public:
  Solver(const Prepared& prepared, const LocalizerOptions& options, StageTimer::Seconds* seconds, Solution* solution)
      : group_(prepared.group),
        layout_(prepared.layout),
        estimates_(prepared.estimates),
        options_(options),
        seconds_(seconds),
        solution_(*solution) {}

  // Adjusts over tracks.
  void SolveByTracks() {
    Averaged& averaged = solution_.averaged;
    averaged = Average();
    StartInput input = MakeStartInput();
    averaged.posed = std::move(input.posed);
    Start start = Timed("start", seconds_,
                        [&] { return ChooseStart(layout_, averaged, input.tracks, options_, input.depth_starts); });
    solution_.starts = start.kinds;
    input.posed = std::move(start.posed);
    const bool is_one_pair = layout_.num_queries == 1 && averaged.pairs.size() == 1;
    if (is_one_pair || (layout_.num_queries == 1 && layout_.priors[0].position)) {
      solution_.input = std::make_shared<StartInput>(std::move(input));
      solution_.refined = RefineAgainFrom(solution_.input->posed);
      if (is_one_pair) solution_.other_orientation = FindOtherOrientation();
    } else {
      solution_.refined = RefineFrom(input.posed, input.tracks, std::move(input.candidates));
    }
    UsePriors();
    AddPoses();
  }

  // Adjusts from the other orientation of a query beside one database image.
  void SolveFromOtherOrientation(const Solution& first) {
    GoOnFrom(first);
    PosedImages start = first.input->posed;
    start.frames[0].frame_from_world = *first.other_orientation;
    solution_.refined = RefineAgainFrom(start);
    AddPoses();
  }

  // Adjusts from where a prior puts the position of a single query, with the priors. Without poses if the images
  // contradict that.
  void SolveFromPositionPrior(const Choice& by_images) {
    GoOnFrom(*by_images.solution);
    Refined refined = *by_images.solution->refined;
    refined.has_one_orientation = by_images.has_one_orientation;
    PriorJudgement judgement =
        Timed("priors", seconds_, [&] { return JudgePriors(layout_, solution_.averaged.pairs, refined, options_); });
    if (!judgement.start) {
      solution_.priors = std::move(judgement.results);
      throw Failure(*by_images.failure);
    }
    PosedImages start = layout_.given;
    start.frames[0].frame_from_world = *judgement.start;
    start.query_priors = std::move(judgement.used);
    for (size_t i = 0; i < start.images.size(); ++i) {
      start.images[i].depth_scale = solution_.input->posed.images[i].depth_scale;
    }
    refined = WithLimitedVarianceFactor(RefineAgainFrom(start));
    refined.has_one_orientation = by_images.has_one_orientation;
    refined.unobservable_line = judgement.unobservable_line;
    solution_.refined = std::move(refined);
    solution_.priors = std::move(judgement.results);
    AddPoses();
  }

  // Estimates the focal length of a single query.
  void SolveWithUnknownFocalLength() {
    const PairRefs pairs = Refs(estimates_.pairs);
    solution_.averaged = {layout_.given, pairs, std::vector<RelativeDirection>(pairs.size()), {}};
    QueryCamera camera(group_.images.front().problem);
    StartInput input = MakeStartInput();
    Timed("start", seconds_, [&] {
      const FocalLengthAndPose found = ChooseFocalLengthAndPose(layout_, camera, input.tracks.from_database, options_);
      camera.ScaleFocalLength(found.factor);
      input.posed.frames[0].frame_from_world = found.frame_from_world;
      input.posed.images[0].log_focal_factor = 0;
      input = ObservedBy(camera, std::move(input));
    });
    solution_.starts = {StartPose::ABSOLUTE_POSE};
    solution_.refined = EstimateFocalLength(input, camera);
    UsePriors();
    AddPoses();
  }

  // Takes the rotation from the images and the position from a prior, for a single query without any baseline.
  void SolveByRotation() {
    solution_.averaged = Average();
    const QueryPrior& prior = layout_.priors[0];
    QueryPriorResult& priors = solution_.priors[0];
    RotationFit fit = Timed("rotation", seconds_, [&] { return FitRotation(layout_, estimates_, solution_.averaged); });
    if (prior.gravity) {
      const PriorComparison comparison = CompareGravity(*prior.gravity, fit.cam_from_world_rotation, fit.covariance);
      const auto used = UsedPrior(*prior.gravity, comparison, &priors.gravity);
      if (used) fit = WithGravity(*used, std::move(fit));
    }
    priors.position = PriorResult{PriorVerdict::USED, PriorRole::POSITION, kUnknown, kUnknown};
    const Rigid3d pose = CamFromWorld(fit.cam_from_world_rotation, prior.position->position);
    solution_.checked.posed = layout_.given;
    solution_.checked.posed.frames[0].frame_from_world = pose;
    solution_.checked.poses = {MakePoseDistribution(pose, fit.covariance, prior.position->covariance)};
    solution_.evidence = {fit.evidence};
    solution_.competing_poses.resize(1);
  }

  // Localizes by the paper's method. Neither checks intrinsics nor uses priors.
  void SolveByPaper() {
    PaperPose pose = LocalizeByPaper(group_, layout_, estimates_, options_, seconds_);
    solution_.averaged = std::move(pose.averaged);
    solution_.starts = {StartPose::MOTION_AVERAGING};
    solution_.refined = std::move(pose.refined);
    solution_.checked.posed = solution_.refined->adjustment.posed;
    solution_.checked.poses = Timed("covariance", seconds_, [&] {
      return EstimateUncertainties(layout_, solution_.averaged.pairs, *solution_.refined, options_);
    });
    Timed("confidence", seconds_, [&] { AddEvidence(*solution_.refined, solution_.checked.poses); });
  }

 private:
  // Returns the start with the query's rays by this camera.
  static StartInput ObservedBy(const QueryCamera& camera, StartInput input) {
    input.tracks = {camera.Observe(input.tracks.from_database), camera.Observe(input.tracks.rest)};
    input.candidates = {camera.Observe(input.candidates.all), camera.Observe(input.candidates.for_start)};
    return input;
  }

  // Estimates the focal length from where the search found it, and from a shorter and a longer one. In images of level
  // ground from above, the estimates can differ by 15 %, although each adjustment takes its own for accurate to 1 %.
  Refined EstimateFocalLength(const StartInput& input, const QueryCamera& camera) {
    std::vector<Refined> estimates = {
        Refine(layout_, input.posed, input.tracks, input.candidates, options_, seconds_, camera)};
    for (const double factor : {kOtherStartFactor, 1 / kOtherStartFactor}) {
      try {
        estimates.push_back(EstimateFocalLengthAgain(input, estimates.front(), factor));
      } catch (const Failure&) {
        continue;  // that start leads nowhere
      }
    }
    return MostLikelyFocalLength(std::move(estimates), input.tracks.from_database, options_);
  }

  // factor: of the start on the first estimate.
  Refined EstimateFocalLengthAgain(const StartInput& input, const Refined& first, double factor) {
    const PosedImages& posed = first.adjustment.posed;
    const double distance = MedianDistance(CamFromWorld(posed, 0), TracksByFrame(layout_, first.adjustment.tracks)[0]);
    QueryCamera camera = *first.camera;
    camera.ScaleFocalLength(factor);
    StartInput start = ObservedBy(camera, input);
    Rigid3d& pose = start.posed.frames[0].frame_from_world;
    pose = posed.frames[0].frame_from_world;
    // Moves the camera with the focal length, so that the scene keeps its size in the image.
    pose.translation +=
        (factor - 1) * distance * (posed.images[0].cam_from_frame.rotation.conjugate() * Eigen::Vector3d::UnitZ());
    return Refine(layout_, start.posed, start.tracks, std::move(start.candidates), options_, seconds_, camera);
  }

  Averaged Average() { return AverageMotion(layout_, estimates_.pairs, options_, seconds_); }

  // Returns the tracks of the pairs in use, triangulated, with the depths that maps give.
  StartInput MakeStartInput() {
    const Averaged& averaged = solution_.averaged;
    StartInput input;
    input.candidates = Timed("tracks", seconds_, [&] { return Collect(averaged.pairs); });
    input.tracks = Timed("start", seconds_, [&] { return TriangulateStart(input.candidates); });
    input.posed = averaged.posed;
    if (!layout_.has_depths) return input;
    input = Timed("depth", seconds_,
                  [&] { return WithDepthMaps(group_, layout_, averaged.pairs, options_, std::move(input)); });
    solution_.depths = std::move(input.depths);
    return input;
  }

  CandidateTracks Collect(const PairRefs& pairs) { return CollectTracks(group_, layout_, pairs); }

  SplitTracks TriangulateStart(const CandidateTracks& candidates) {
    return TriangulateFromDatabase(layout_.given, candidates.for_start, options_.triangulation);
  }

  // Takes over what the stages before adjustment have found.
  void GoOnFrom(const Solution& first) {
    solution_.averaged = first.averaged;
    solution_.starts = first.starts;
    solution_.depths = first.depths;
    solution_.input = first.input;
  }

  Refined RefineAgainFrom(const PosedImages& start) {
    return RefineFrom(start, solution_.input->tracks, solution_.input->candidates);
  }

  // Refines by the images alone. Beside a single database image, points of smaller angles are used, because it sees
  // them no better.
  Refined RefineFrom(const PosedImages& start, const SplitTracks& tracks, CandidateTracks candidates) {
    const PairRefs& pairs = solution_.averaged.pairs;
    const bool is_beside_one_image = std::all_of(pairs.begin(), pairs.end(), [&](const PairGeometry* pair) {
      return layout_.IsDatabase(pair->other) && pair->other == pairs.front()->other;
    });
    LocalizerOptions options = options_;
    if (is_beside_one_image) options.triangulation.min_triangulation_angle_deg *= kSmallAngleRatio;
    return Refine(layout_, start, tracks, std::move(candidates), options, seconds_);
  }

  // Returns the other orientation of a query beside one database image; nullopt if there is none, or if the images
  // determine its position.
  std::optional<Rigid3d> FindOtherOrientation() const {
    const PairRefs& pairs = solution_.averaged.pairs;
    const Refined& refined = *solution_.refined;
    const BundleAdjustmentResult& adjustment = refined.adjustment;
    const TrackRefs tracks = TracksByFrame(layout_, adjustment.tracks)[0];
    if (static_cast<int>(tracks.size()) < kMinNumTracks) return std::nullopt;
    if (!IsPositionUnobservable({layout_, pairs, adjustment, 0, tracks, refined.variance_factor}, options_)) {
      return std::nullopt;
    }
    return OtherOrientation(CamFromWorld(adjustment.posed, 0), CamFromWorld(adjustment.posed, pairs.front()->other),
                            tracks);
  }

  // Compares the priors with the refined poses, and adjusts with those that are not contradicted. Those that fix a
  // position that the images do not determine are left to another hypothesis.
  void UsePriors() {
    if (!HavePriors(layout_)) return;
    Timed("priors", seconds_, [&] {
      PriorJudgement judgement = JudgePriors(layout_, solution_.averaged.pairs, *solution_.refined, options_);
      if (judgement.start) return;
      solution_.priors = std::move(judgement.results);
      solution_.refined = AdjustWithPriors(judgement.used, options_, *std::move(solution_.refined));
    });
  }

  // Adds the refined poses with their uncertainties, intrinsics and evidence.
  void AddPoses() {
    const Refined& refined = *solution_.refined;
    CheckedIntrinsics checked = Timed("covariance", seconds_, [&] {
      return CheckIntrinsics(group_, layout_, refined,
                             EstimateUncertainties(layout_, solution_.averaged.pairs, refined, options_), options_);
    });
    if (HavePriors(layout_)) {
      FusedPriors fused =
          Timed("priors", seconds_, [&] { return FusePriors(layout_, solution_.priors, std::move(checked)); });
      checked = std::move(fused.checked);
      solution_.priors = std::move(fused.results);
    }
    Timed("confidence", seconds_, [&] { AddEvidence(refined, checked.poses); });
    solution_.checked = std::move(checked);
  }

  void AddEvidence(const Refined& refined, const std::vector<PoseDistribution>& poses) {
    solution_.evidence = MeasureEvidence(layout_, estimates_.num_inliers, refined, poses);
    AddCompetingPoses(refined);
  }

  // Adds the poses that compete with those of frames that leave many matches unexplained. They come from all pairs,
  // because averaging may have left out those that speak for another pose.
  void AddCompetingPoses(const Refined& refined) {
    solution_.competing_poses.resize(layout_.num_query_frames);
    std::vector<int> frames;
    for (int frame = 0; frame < layout_.num_query_frames; ++frame) {
      if (solution_.evidence[frame].explained_ratio < kEnoughExplained) frames.push_back(frame);
    }
    if (frames.empty()) return;
    CandidateTracks candidates = Collect(Refs(estimates_.pairs));
    if (refined.camera) candidates.for_start = refined.camera->Observe(candidates.for_start);
    const SplitTracks tracks = TriangulateStart(candidates);
    const std::vector<TrackRefs> from_database = TracksByFrame(layout_, tracks.from_database),
                                 rest = TracksByFrame(layout_, tracks.rest);
    for (const int frame : frames) {
      const std::optional<CompetingPose> competing =
          FindCompetingPose(layout_, from_database[frame], rest[frame], frame,
                            refined.adjustment.posed.frames[frame].frame_from_world, options_.seed);
      if (!competing) continue;
      solution_.evidence[frame].competing_ratio = competing->score_ratio;
      solution_.competing_poses[frame] = competing->frame_from_world;
    }
  }

  const QueryGroup& group_;
  const Layout& layout_;
  const PairEstimates& estimates_;
  const LocalizerOptions& options_;
  StageTimer::Seconds* const seconds_;
  Solution& solution_;
};

}  // namespace

Solution Solve(const Prepared& prepared, const Hypothesis& hypothesis, const Choice* given,
               const LocalizerOptions& options, StageTimer::Seconds* seconds) {
  Solution solution;
  solution.hypothesis = hypothesis;
  solution.prepared = &prepared;
  for (const QueryImage& query : prepared.group.images) {
    solution.priors.push_back(UntestedPriors(query.problem.prior));
    solution.checked.results.emplace_back().origin = query.problem.intrinsics_origin;
  }
  try {
    if (prepared.failure) throw Failure(*prepared.failure);
    Solver solver(prepared, options, seconds, &solution);
    if (hypothesis.estimates_focal_length) {
      solver.SolveWithUnknownFocalLength();
    } else if (hypothesis.approach == Approach::OTHER_ORIENTATION) {
      solver.SolveFromOtherOrientation(*given->solution);
    } else if (hypothesis.approach == Approach::POSITION_PRIOR) {
      solver.SolveFromPositionPrior(*given);
    } else if (hypothesis.approach == Approach::ROTATION) {
      solver.SolveByRotation();
    } else if (hypothesis.approach == Approach::PAPER) {
      solver.SolveByPaper();
    } else {
      solver.SolveByTracks();
    }
  } catch (const Failure& failure) {
    solution.failure = failure;
  }
  return solution;
}

}  // namespace lazyloc

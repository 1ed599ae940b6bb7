#include "colmap_lazyloc/pipeline/refinement_with_priors.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "colmap_lazyloc/priors/plane_orientation.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Minimum share of the matches in tracks with which a pose is the only one if its other orientation has none.
constexpr double kMinTrackRatio = 0.5;

// Factor on the minimum triangulation angle beside a single database image.
constexpr double kSmallAngleRatio = 0.2;

// Returns true if all pairs are with the same database image.
bool AreBesideOneImage(const Layout& layout, const PairRefs& pairs) {
  return std::all_of(pairs.begin(), pairs.end(), [&](const PairGeometry* pair) {
    return layout.IsDatabase(pair->other) && pair->other == pairs.front()->other;
  });
}

// Returns the options of refinement. Beside a single image, points of smaller angles are used, because it sees them no
// better.
LocalizerOptions RefinementOptions(const Layout& layout, const PairRefs& pairs, LocalizerOptions options) {
  if (AreBesideOneImage(layout, pairs)) options.triangulation.min_triangulation_angle_deg *= kSmallAngleRatio;
  return options;
}

bool IsOnePair(const Layout& layout, const PairRefs& pairs) { return layout.num_queries == 1 && pairs.size() == 1; }

// Refines a single query from several starts.
class Refinement {
 public:
  Refinement(const Layout& layout, const PairRefs& pairs, const SplitTracks& start_tracks, CandidateTracks candidates,
             const LocalizerOptions& options, StageTimer::Seconds* seconds)
      : layout_(layout),
        pairs_(pairs),
        start_tracks_(start_tracks),
        candidates_(std::move(candidates)),
        options_(options),
        seconds_(seconds) {}

  Refined From(const PosedImages& start) const {
    return Refine(layout_, start, start_tracks_, candidates_, options_, seconds_);
  }

  // Refines from the other orientation too, if the position is unobservable. Returns the better one.
  Refined WithOtherOrientation(const PosedImages& start, Refined refined) const {
    const BundleAdjustmentResult& adjustment = refined.adjustment;
    const TrackRefs tracks = TracksByFrame(layout_, adjustment.tracks)[0];
    if (static_cast<int>(tracks.size()) < kMinNumTracks) return refined;
    if (!IsPositionUnobservable({layout_, pairs_, adjustment, 0, tracks, refined.variance_factor}, options_))
      return refined;
    const std::optional<Rigid3d> pose = OtherOrientation(CamFromWorld(adjustment.posed, 0),
                                                         CamFromWorld(adjustment.posed, pairs_.front()->other), tracks);
    if (!pose) return refined;
    PosedImages other_start = start;
    other_start.frames[0].frame_from_world = *pose;
    const std::vector<Track>& matches = start_tracks_.rest;
    std::optional<Refined> other;
    try {
      other = From(other_start);
    } catch (const Failure&) {
      const double num_matches = static_cast<double>(matches.size());
      if (static_cast<double>(tracks.size()) > kMinTrackRatio * num_matches) refined.has_one_orientation = true;
      return refined;
    }
    return ChooseOrientation(layout_, pairs_, matches, std::move(refined), *std::move(other));
  }

  // Refines a pose whose position is unobservable again, from where the priors put it. Returns the pose as it is if
  // that fails.
  RefinedWithPriors Fixed(const PosedImages& start, const PriorJudgement& judgement, Refined refined) const {
    PosedImages moved = layout_.given;
    moved.frames[0].frame_from_world = judgement.start.frames[0].frame_from_world;
    moved.query_priors = judgement.used;
    RefinedWithPriors result{std::move(refined), judgement.results};
    for (size_t i = 0; i < moved.images.size(); ++i) moved.images[i].depth_scale = start.images[i].depth_scale;
    try {
      Refined fixed = WithLimitedVarianceFactor(From(moved));
      if (AreReconciled(judgement, fixed)) {
        fixed.has_one_orientation = result.refined.has_one_orientation;
        fixed.unobservable_line = judgement.unobservable_line;
        result.refined = std::move(fixed);
      } else {
        result.priors[0].position->verdict = PriorVerdict::CONTRADICTED;
      }
    } catch (const Failure&) {
      result.priors[0] = UntestedPriors(layout_.priors[0]);
    }
    return result;
  }

 private:
  const Layout& layout_;
  const PairRefs& pairs_;
  const SplitTracks& start_tracks_;
  const CandidateTracks candidates_;
  const LocalizerOptions& options_;
  StageTimer::Seconds* const seconds_;
};

}  // namespace

bool HavePriors(const Layout& layout) {
  return std::any_of(layout.priors.begin(), layout.priors.end(),
                     [](const QueryPrior& prior) { return prior.position || prior.gravity; });
}

RefinedWithPriors RefineWithPriors(const Layout& layout, const PairRefs& pairs, const PosedImages& start,
                                   const SplitTracks& start_tracks, CandidateTracks candidates,
                                   const LocalizerOptions& options, StageTimer::Seconds* seconds) {
  std::vector<QueryPriorResult> untested;
  for (const QueryPrior& prior : layout.priors) untested.push_back(UntestedPriors(prior));
  const LocalizerOptions refinement_options = RefinementOptions(layout, pairs, options);
  if (!HavePriors(layout) && !IsOnePair(layout, pairs)) {
    return {Refine(layout, start, start_tracks, std::move(candidates), refinement_options, seconds),
            std::move(untested)};
  }
  const Refinement refinement(layout, pairs, start_tracks, std::move(candidates), refinement_options, seconds);
  Refined refined = refinement.From(start);
  if (IsOnePair(layout, pairs)) refined = refinement.WithOtherOrientation(start, std::move(refined));
  if (!HavePriors(layout)) return {std::move(refined), std::move(untested)};
  PriorJudgement judgement = [&] {
    const StageTimer timer("priors", seconds);
    return JudgePriors(layout, pairs, refined, options);
  }();
  if (judgement.moves_start) return refinement.Fixed(start, judgement, std::move(refined));
  if (!judgement.used.empty()) {
    const StageTimer timer("priors", seconds);
    refined = AdjustWithPriors(judgement.used, options, std::move(refined));
  }
  return {std::move(refined), std::move(judgement.results)};
}

}  // namespace lazyloc

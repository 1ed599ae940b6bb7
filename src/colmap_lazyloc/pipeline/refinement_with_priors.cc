#include "colmap_lazyloc/pipeline/refinement_with_priors.h"

#include <algorithm>
#include <functional>
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

// Returns the options of refinement. Beside a single image, points of smaller angles are used, because it sees them no
// better.
LocalizerOptions RefinementOptions(const Layout& layout, const PairRefs& pairs, LocalizerOptions options) {
  const bool is_beside_one_image = std::all_of(pairs.begin(), pairs.end(), [&](const PairGeometry* pair) {
    return layout.IsDatabase(pair->other) && pair->other == pairs.front()->other;
  });
  if (is_beside_one_image) options.triangulation.min_triangulation_angle_deg *= kSmallAngleRatio;
  return options;
}

// Refines from a start, with all else given.
using Refinement = std::function<Refined(const PosedImages& start)>;

// Refines from the other orientation too, if the position is unobservable. Returns the better one.
Refined WithOtherOrientation(const Layout& layout, const PairRefs& pairs, const PosedImages& start,
                             const std::vector<Track>& matches, const LocalizerOptions& options,
                             const Refinement& refine_from, Refined refined) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const TrackRefs tracks = TracksByFrame(layout, adjustment.tracks)[0];
  if (static_cast<int>(tracks.size()) < kMinNumTracks) return refined;
  if (!IsPositionUnobservable({layout, pairs, adjustment, 0, tracks, refined.variance_factor}, options)) return refined;
  const std::optional<Rigid3d> pose =
      OtherOrientation(CamFromWorld(adjustment.posed, 0), CamFromWorld(adjustment.posed, pairs.front()->other), tracks);
  if (!pose) return refined;
  PosedImages other_start = start;
  other_start.frames[0].frame_from_world = *pose;
  std::optional<Refined> other;
  try {
    other = refine_from(other_start);
  } catch (const Failure&) {
    const double num_matches = static_cast<double>(matches.size());
    if (static_cast<double>(tracks.size()) > kMinTrackRatio * num_matches) refined.has_one_orientation = true;
    return refined;
  }
  return ChooseOrientation(layout, pairs, matches, std::move(refined), *std::move(other));
}

// Refines a pose whose position is unobservable again, from where the priors put it. Returns the pose as it is if
// that fails.
RefinedWithPriors FixByPriors(const Layout& layout, const PosedImages& start, const Refinement& refine_from,
                              PriorJudgement judgement, Refined refined) {
  PosedImages moved = layout.given;
  moved.frames[0].frame_from_world = *judgement.start;
  moved.query_priors = judgement.used;
  for (size_t i = 0; i < moved.images.size(); ++i) moved.images[i].depth_scale = start.images[i].depth_scale;
  RefinedWithPriors result{std::move(refined), std::move(judgement.results)};
  try {
    Refined fixed = WithLimitedVarianceFactor(refine_from(moved));
    if (AreReconciled(judgement, fixed)) {
      fixed.has_one_orientation = result.refined.has_one_orientation;
      fixed.unobservable_line = judgement.unobservable_line;
      result.refined = std::move(fixed);
    } else {
      result.priors[0].position->verdict = PriorVerdict::CONTRADICTED;
    }
  } catch (const Failure&) {
    result.priors[0] = UntestedPriors(layout.priors[0]);
  }
  return result;
}

}  // namespace

bool HavePriors(const Layout& layout) {
  return std::any_of(layout.priors.begin(), layout.priors.end(),
                     [](const QueryPrior& prior) { return prior.position || prior.gravity; });
}

RefinedWithPriors RefineWithPriors(const Layout& layout, const PairRefs& pairs, const PosedImages& start,
                                   const SplitTracks& start_tracks, CandidateTracks candidates,
                                   const LocalizerOptions& options, StageTimer::Seconds* seconds) {
  const bool have_priors = HavePriors(layout), is_one_pair = layout.num_queries == 1 && pairs.size() == 1;
  const LocalizerOptions refinement_options = RefinementOptions(layout, pairs, options);
  const Refinement refine_from = [&](const PosedImages& from) {
    // Copies the tracks only if it may run again.
    return Refine(layout, from, start_tracks, have_priors || is_one_pair ? candidates : std::move(candidates),
                  refinement_options, seconds);
  };
  Refined refined = refine_from(start);
  if (is_one_pair) {
    refined = WithOtherOrientation(layout, pairs, start, start_tracks.rest, refinement_options, refine_from,
                                   std::move(refined));
  }
  if (!have_priors) return {std::move(refined), std::vector<QueryPriorResult>(layout.num_queries)};
  PriorJudgement judgement = Timed("priors", seconds, [&] { return JudgePriors(layout, pairs, refined, options); });
  if (judgement.start) return FixByPriors(layout, start, refine_from, std::move(judgement), std::move(refined));
  refined = Timed("priors", seconds, [&] { return AdjustWithPriors(judgement.used, options, std::move(refined)); });
  return {std::move(refined), std::move(judgement.results)};
}

}  // namespace lazyloc

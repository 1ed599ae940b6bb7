#include "ablation.h"

#include <algorithm>

#include "averaging_methods.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/initialization/motion_averaging.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/paper/paper_method.h"
#include "colmap_lazyloc/pipeline/prepare.h"
#include "colmap_lazyloc/refinement/sampson_refinement.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"
#include "colmap_lazyloc/scene/errors.h"
#include "relative_pose_refinement.h"

namespace lazyloc {
namespace {

// The stage after motion averaging.
enum class PostOptimization {
  TRACKS,            // the paper's
  SAMPSON,           // epipolar errors of the matches
  RELATIVE_POSE_LO,  // relative poses alone (Zhou et al. 2020)
  NONE,
};

struct Ablation {
  const char* name;
  AveragingMethods averaging;
  PostOptimization post_optimization = PostOptimization::TRACKS;
};

const Ablation kAblations[] = {
    {"none", {}},
    {"l1", {AverageByL1, AverageByAngles}},
    {"quaternion_mean", {AverageByQuaternionMean, AverageByAngles}},
    {"lud", {AverageByL1Irls, AverageByLeastUnsquaredDeviations}},
    {"averaging_alone", {}, PostOptimization::NONE},
    {"lud_alone", {AverageByL1Irls, AverageByLeastUnsquaredDeviations}, PostOptimization::NONE},
    {"sampson", {}, PostOptimization::SAMPSON},
    {"relative_pose_lo", {}, PostOptimization::RELATIVE_POSE_LO},
};

// Returns the pose of the query after the stage. Throws Failure if that fails.
PosedImages PostOptimize(PostOptimization method, const QueryGroup& query, const Layout& layout,
                         const Averaged& averaged, const LocalizerOptions& options) {
  PoseRefinementResult result;
  switch (method) {
    case PostOptimization::NONE: return averaged.posed;
    case PostOptimization::TRACKS: {
      StageTimer::Seconds seconds;
      return AdjustByPaper(query, layout, averaged, &seconds).adjustment.posed;
    }
    case PostOptimization::SAMPSON:
      result = RefineBySampsonError(averaged.posed, CollectTracks(query, layout, averaged.pairs).all);
      break;
    case PostOptimization::RELATIVE_POSE_LO: {
      std::vector<RelativePoseEdge> edges;
      for (const PairGeometry* pair : averaged.pairs) {
        edges.push_back({pair->other, pair->query, pair->query_from_other});
      }
      result = RefineByRelativePoses(averaged.posed, edges, SeedFromNames(layout.names[0], "", options.seed));
    }
  }
  if (!result.summary.success) throw Failure{QueryStatus::DIVERGED, result.summary.message};
  return result.posed;
}

}  // namespace

std::vector<std::string> AblationNames() {
  std::vector<std::string> names;
  for (const Ablation& ablation : kAblations) names.emplace_back(ablation.name);
  return names;
}

AblatedResult LocalizeByAblation(const std::string& name, const QueryGroup& query, const LocalizerOptions& options) {
  const auto* ablation = std::find_if(std::begin(kAblations), std::end(kAblations),
                                      [&](const Ablation& candidate) { return candidate.name == name; });
  if (ablation == std::end(kAblations)) throw InputError("there is no ablation " + name);
  LocalizerOptions paper = options;
  paper.method = Method::PAPER;
  StageTimer::Seconds seconds;
  KnownRelativePoses known;
  Preparations preparations(query);
  const Prepared& prepared = preparations.For({false, "", Approach::PAPER}, paper, &known, &seconds);
  try {
    if (prepared.failure) throw Failure(*prepared.failure);
    const Averaged averaged =
        AverageAgreeing(prepared.layout, prepared.estimates.pairs, paper, &seconds, ablation->averaging);
    const PosedImages posed =
        PostOptimize(ablation->post_optimization, prepared.group, prepared.layout, averaged, paper);
    return {QueryStatus::LOCALIZED, PoseInWorld(prepared.layout, posed, 0)};
  } catch (const Failure& failure) {
    return {failure.cause, {}};
  }
}

}  // namespace lazyloc

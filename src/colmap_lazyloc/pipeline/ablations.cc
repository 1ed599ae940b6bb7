#include "colmap_lazyloc/pipeline/ablations.h"

#include <limits>

#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/pipeline/track_collection.h"

namespace lazyloc {
namespace {

StageSummary RefineBySampsonError(QueryState* state) {
  CollectTracks(state);
  return RefineBySampsonError(state->options.sampson, state->candidates, &state->views);
}

StageSummary RefineByRelativePoses(QueryState* state) {
  std::vector<RelativePoseEdge> edges;
  for (const PairState& pair : state->pairs) {
    edges.push_back({pair.view, 0, pair.relative_pose.query_from_other});
  }
  const uint32_t seed = SeedFromNames(state->Problem(0).query_name, "", state->options.seed);
  return RefineByRelativePoses(state->options.relative_pose_lo, edges, seed, &state->views);
}

}  // namespace

void RefineWithoutTracks(QueryState* state) {
  if (state->averaging_failure) throw *state->averaging_failure;
  state->results[0].start = EnumName(StartPose::MOTION_AVERAGING);
  state->results[0].covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  StageSummary summary{true, "", 0, 0};
  switch (state->options.post_optimization) {
    case PostOptimization::SAMPSON: summary = RefineBySampsonError(state); break;
    case PostOptimization::RELATIVE_POSE_LO: summary = RefineByRelativePoses(state); break;
    default: break;
  }
  if (!summary.success) throw QueryFailure{QueryStatus::DIVERGED, summary.message};
}

}  // namespace lazyloc

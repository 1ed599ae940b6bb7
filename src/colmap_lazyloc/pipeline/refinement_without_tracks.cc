#include "colmap_lazyloc/pipeline/refinement_without_tracks.h"

#include "colmap_lazyloc/ablation/pose_refinement.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {
namespace {

PoseRefinementResult RefineByRelativePoses(const Layout& layout, const Averaged& averaged,
                                           const LocalizerOptions& options) {
  std::vector<RelativePoseEdge> edges;
  for (const PairGeometry* pair : averaged.pairs) edges.push_back({pair->other, pair->query, pair->query_from_other});
  return RefineByRelativePoses(averaged.posed, edges, SeedFromNames(layout.names[0], "", options.seed));
}

PosedImages PosedOrFailure(const PoseRefinementResult& result) {
  if (!result.summary.success) throw Failure{QueryStatus::DIVERGED, result.summary.message};
  return result.posed;
}

}  // namespace

PosedImages RefineWithoutTracks(const QueryGroup& query, const Layout& layout, const Averaged& averaged,
                                const LocalizerOptions& options) {
  switch (options.post_optimization) {
    case PostOptimization::SAMPSON: {
      const CandidateTracks tracks = CollectTracks(query, layout, averaged.pairs);
      return PosedOrFailure(RefineBySampsonError(averaged.posed, tracks.all));
    }
    case PostOptimization::RELATIVE_POSE_LO: return PosedOrFailure(RefineByRelativePoses(layout, averaged, options));
    default: return averaged.posed;
  }
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/refinement_without_tracks.h"

#include "colmap_lazyloc/ablation/pose_refinement.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {
PosedImages RefineWithoutTracks(const QueryGroup& query, const Layout& layout, const Averaged& averaged,
                                const LocalizerOptions& options) {
  PoseRefinementResult result;
  if (options.post_optimization == PostOptimization::SAMPSON) {
    result = RefineBySampsonError(averaged.posed, CollectTracks(query, layout, averaged.pairs).all);
  } else if (options.post_optimization == PostOptimization::RELATIVE_POSE_LO) {
    std::vector<RelativePoseEdge> edges;
    for (const PairGeometry* pair : averaged.pairs) edges.push_back({pair->other, pair->query, pair->query_from_other});
    result = RefineByRelativePoses(averaged.posed, edges, SeedFromNames(layout.names[0], "", options.seed));
  } else {
    return averaged.posed;
  }
  if (!result.summary.success) throw Failure{QueryStatus::DIVERGED, result.summary.message};
  return result.posed;
}

}  // namespace lazyloc

#include "colmap_lazyloc/features/pair_matching.h"

#include "colmap_lazyloc/bridge/two_view_estimation.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

TwoViewGeometry Verify(const LocalizationProblem& problem, const ImagePair& pair, int seed) {
  // A wrong focal length loses right matches, so that one that nobody has stated must not choose them.
  const bool is_calibrated = IsCalibrated(problem.intrinsics_origin);
  TwoViewGeometry geometry;
  if (static_cast<int>(pair.matches.size()) >= kMinNumInliers) {
    geometry = EstimateTwoViewGeometry(problem, pair, pair.matches, is_calibrated,
                                       SeedFromNames(problem.query_name, pair.other_name, seed));
  }
  // Marks the pair as unusable, because nothing more can be found in these matches.
  const bool is_usable =
      HoldsCalibrated(geometry.config) || (!is_calibrated && geometry.config == TwoViewConfig::UNCALIBRATED);
  if (!is_usable) geometry.config = TwoViewConfig::DEGENERATE;
  return geometry;
}

}  // namespace

void MatchPairs(const FeatureMethod& method, const Features& query_features,
                const std::vector<std::shared_ptr<const Features>>& database_features, int seed,
                IdleThreads* idle_threads, LocalizationProblem* problem, StageTimer::Seconds* seconds) {
  std::vector<ImagePair>& pairs = problem->pairs;
  LAZYLOC_CHECK(database_features.size() == pairs.size());
  {
    const StageTimer timer("matching", seconds);
    ParallelFor(
        pairs.size(),
        [&](size_t i) {
          const Features& features = *database_features[i];
          pairs[i].matches = method.Match(query_features, problem->query_camera, features, pairs[i].other_camera);
          pairs[i].other_keypoints = Positions(features.keypoints);
        },
        idle_threads);
  }
  const StageTimer timer("verification", seconds);
  ParallelFor(
      pairs.size(), [&](size_t i) { pairs[i].geometry = Verify(*problem, pairs[i], seed); }, idle_threads);
}

}  // namespace lazyloc

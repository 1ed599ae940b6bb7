#pragma once

#include <memory>
#include <vector>

#include "colmap_lazyloc/features/feature_method.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {

struct PairMatchingOptions {
  int seed = 0;  // of RANSAC
  // True: compares all features of a pair with each other. False: first those of the largest scales, which give the
  // two-view geometry; then all features along its epipolar lines, if the method can.
  bool compares_all = false;
  // Number of pairs that are verified if the largest features are compared first: those with the most matches of these.
  // 0: all pairs.
  int max_num_verified = 0;
};

// Matches the query with the database image of each of the problem's pairs and verifies the matches by COLMAP's
// two-view geometry. The problem has names, cameras and the query's keypoints; this sets the pairs' other_keypoints,
// raw matches and geometry, which is DEGENERATE if verification fails. database_features: one per pair. The result does
// not depend on the number of threads. Adds the stages "matching" and "verification" to `seconds`.
void MatchPairs(const FeatureMethod& method, const Features& query_features,
                const std::vector<std::shared_ptr<const Features>>& database_features,
                const PairMatchingOptions& options, IdleThreads* idle_threads, LocalizationProblem* problem,
                StageTimer::Seconds* seconds);

// True if the largest features of a matched problem are not all: `compares_all` may find more matches.
bool HasFurtherFeatures(const FeatureMethod& method, const LocalizationProblem& problem);

}  // namespace lazyloc

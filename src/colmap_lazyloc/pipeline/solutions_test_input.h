#pragma once

#include <utility>

#include "colmap_lazyloc/pipeline/solve.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {

// A group, a single query by default, and solutions that nothing has solved.
class MadeUpQuery {
 public:
  explicit MadeUpQuery(QueryGroup group = LoneQuery(MakeSyntheticScene({}))) : group_(std::move(group)) {
    prepared_.layout = MakeLayout(group_);
    for (const QueryImage& image : group_.images) {
      prepared_.estimates.num_inliers.emplace_back(image.problem.pairs.size(), 50);
    }
  }
  MadeUpQuery(const MadeUpQuery&) = delete;
  MadeUpQuery& operator=(const MadeUpQuery&) = delete;

  const QueryGroup& Group() const { return group_; }
  LocalizationProblem& Problem() { return group_.images.front().problem; }

  // Returns a solution with poses of high confidence, whose intrinsics are confirmed.
  Solution Solved(const Hypothesis& hypothesis) const {
    Solution solution;
    solution.hypothesis = hypothesis;
    solution.prepared = &prepared_;
    for (const QueryImage& image : group_.images) {
      solution.priors.push_back(UntestedPriors(image.problem.prior));
      solution.checked.results.push_back({image.problem.intrinsics_origin, IntrinsicsVerdict::CONFIRMED, 1, 0.001, ""});
    }
    solution.checked.poses.resize(group_.images.size());
    PoseEvidence evidence;
    evidence.num_common_tracks = 200;
    evidence.explained_ratio = 1;
    solution.evidence.assign(group_.frame_names.size(), evidence);
    solution.competing_poses.resize(group_.frame_names.size());
    return solution;
  }

  // Returns the evidence for a pose of low confidence, with enough points.
  static PoseEvidence Unlikely() {
    PoseEvidence evidence;
    evidence.num_common_tracks = 20;
    evidence.explained_ratio = 0.02;
    evidence.median_error_px = 2;
    return evidence;
  }

 private:
  QueryGroup group_;
  Prepared prepared_{group_, {}, {}};
};

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/solve.h"

namespace lazyloc {

// The solution that explains the images best, and what the others say of it.
struct Choice {
  const Solution* solution = nullptr;
  std::vector<IntrinsicsResult> intrinsics;  // by query: as all solutions leave them
  // What the covariances lack of the expected square of the error of the log focal length; none if negative.
  double missing_mean_square = 0;
  const Solution* runner_up = nullptr;  // the most credible of the other solutions with poses; null without any
};

// Chooses among the solutions of a group, which are in the order of NextHypothesis. There is at least one.
Choice Choose(const std::vector<Solution>& solutions, const LocalizerOptions& options);

// Returns the contradiction for which a frame is refused; null if there is none. In IntrinsicsMode::GIVEN, a
// contradiction is no reason to refuse a pose.
const IntrinsicsResult* RefusedIntrinsics(const Layout& layout, const std::vector<IntrinsicsResult>& intrinsics,
                                          int frame, const LocalizerOptions& options);

// Returns the frames without a pose, or with contradicted intrinsics. All frames if the failure is the whole group's.
std::vector<int> FramesWithoutPose(const Choice& choice, const LocalizerOptions& options);

// Returns true if a single query has no pose by the solution, or one that is less credible than the options ask for.
bool IsRefused(const Solution& solution, const LocalizerOptions& options);

// Returns true if the images show too little that a given focal length is right, so that it is estimated, too.
bool IsFocalLengthUncertain(const Solution& given, const LocalizerOptions& options);

}  // namespace lazyloc

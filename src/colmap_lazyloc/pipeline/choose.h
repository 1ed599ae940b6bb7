#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/solve.h"
#include "colmap_lazyloc/scene/query_status.h"

namespace lazyloc {

// The solution that explains the images best, and what the others say of it.
struct Choice {
  const Solution* solution = nullptr;
  std::vector<IntrinsicsResult> intrinsics;  // by query: after all solutions were compared
  // Extra variance of the log focal length to add to the reported covariance; none if negative.
  double extra_log_focal_variance = 0;
  const Solution* runner_up = nullptr;  // the most credible of the other solutions with poses; null without any
};

// Chooses among the solutions of a group, which are in the order of NextHypothesis. There is at least one.
Choice Choose(const std::vector<Solution>& solutions, const LocalizerOptions& options);

// What is chosen for one image of a group.
struct ImageChoice {
  std::shared_ptr<const Choice> choice;  // shared by the images that were solved together
  int query = 0;                         // the image's index in the solution
  StageTimer::Seconds seconds;           // the image's share of all solves that it took part in
};

// Returns what is chosen for an image that was tried twice with different matches: the later attempt if only that one
// localizes the image. Adds up the seconds.
ImageChoice Better(ImageChoice earlier, ImageChoice later, const LocalizerOptions& options);

// Returns why a query of the chosen solution is not LOCALIZED; nullopt if it is.
std::optional<Refusal> RefusalOf(const Choice& choice, int query, const LocalizerOptions& options);

// Returns the frames without a pose, or with contradicted intrinsics. All frames if the failure is the whole group's.
std::vector<int> FramesWithoutPose(const Choice& choice, const LocalizerOptions& options);

// Returns true if a single query has no pose by the solution, or one that is less credible than the options ask for.
bool IsRefused(const Solution& solution, const LocalizerOptions& options);

// Returns true if the images show too little that a given focal length is right, so that it is estimated, too.
bool IsFocalLengthUncertain(const Solution& given, const LocalizerOptions& options);

}  // namespace lazyloc

#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/solve.h"
#include "colmap_lazyloc/scene/query_status.h"

namespace lazyloc {

// The solution that explains the images best, and what is known of it after it was compared with the others.
struct Choice {
  Choice() = default;
  explicit Choice(const Solution& solved);  // as it was solved

  const Solution* solution = nullptr;
  std::optional<Failure> failure;            // nullopt if there are poses
  std::vector<QueryPriorResult> priors;      // by query
  std::vector<IntrinsicsResult> intrinsics;  // by query
  // Extra variance of the log focal length to add to the reported covariance; none if negative.
  double extra_log_focal_variance = 0;
  // False if the other orientation that a plane leaves beside a single database image is not excluded; nullopt if there
  // is nothing to compare.
  std::optional<bool> has_one_orientation;
  const Solution* runner_up = nullptr;  // the other one with poses, if the focal length was given and estimated
};

// The choices among the solutions of a group so far.
struct Choices {
  // Adds a solution, in the order of NextHypothesis, which must outlive this.
  void Add(const Solution& next);

  std::optional<Choice> given, estimated;  // with given intrinsics, with an estimated focal length
  const Solution* last = nullptr;
};

// Chooses between given intrinsics and an estimated focal length. There is at least one solution.
Choice Choose(const Choices& choices, const LocalizerOptions& options);

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

// Returns true if the position is unobservable after adjustment over tracks.
bool IsPositionOpen(const Choice& choice);

// Returns true if a single query has no pose, or one that is less credible than the options ask for.
bool IsRefused(const Choice& choice, const LocalizerOptions& options);

// Returns true if the images show too little that a given focal length is right, so that it is estimated, too.
bool IsFocalLengthUncertain(const Choice& given, const LocalizerOptions& options);

}  // namespace lazyloc

#pragma once

#include <list>
#include <optional>
#include <utility>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/pipeline/hypotheses.h"

namespace lazyloc {

// Input shared by hypotheses that use the same pairs and treat the focal length alike.
struct Prepared {
  const QueryGroup& group;
  Layout layout;
  PairEstimates estimates;           // without relative poses if the focal length is estimated
  std::optional<Failure> failure{};  // nullopt if the group can be solved
};

// Prepares a group for hypotheses, once for those that share it. The group must outlive this.
class Preparations {
 public:
  explicit Preparations(const QueryGroup& group) : group_(group) {}
  Preparations(const Preparations&) = delete;
  Preparations& operator=(const Preparations&) = delete;

  // Returns a reference that stays valid. Uses and adds to the relative poses that are known.
  const Prepared& For(const Hypothesis& hypothesis, const LocalizerOptions& options, KnownRelativePoses* known,
                      StageTimer::Seconds* seconds);

 private:
  const QueryGroup& group_;
  QueryGroup group_of_one_pair_;  // that of a hypothesis with only_database_image, of which there is at most one
  std::list<std::pair<Hypothesis, Prepared>> prepared_;
};

}  // namespace lazyloc

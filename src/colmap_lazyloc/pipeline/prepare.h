#pragma once

#include <list>
#include <optional>
#include <utility>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/pipeline/hypotheses.h"

namespace lazyloc {

// What all hypotheses with the same pairs are solved from, whose focal length is stated or estimated.
struct Prepared {
  const QueryGroup& group;
  Layout layout;
  PairEstimates estimates;           // without relative poses if the focal length is estimated
  std::optional<Failure> failure{};  // nullopt if the group can be solved
};

// Prepares a group for hypotheses, once for those that share it.
class Preparations {
 public:
  // Uses and adds to the relative poses that are known.
  Preparations(const QueryGroup& group, const LocalizerOptions& options, KnownRelativePoses* known,
               StageTimer::Seconds* seconds)
      : group_(group), options_(options), known_(known), seconds_(seconds) {}

  // Returns a reference that stays valid.
  const Prepared& For(const Hypothesis& hypothesis);

 private:
  const QueryGroup& group_;
  const LocalizerOptions& options_;
  KnownRelativePoses* const known_;
  StageTimer::Seconds* const seconds_;
  QueryGroup group_of_one_pair_;  // that of a hypothesis with only_database_image, of which there is at most one
  std::list<std::pair<Hypothesis, Prepared>> prepared_;
};

}  // namespace lazyloc

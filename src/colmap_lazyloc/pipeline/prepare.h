#pragma once

#include <list>
#include <map>
#include <optional>
#include <string>
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

// The relative poses of pairs, by whether the focal length is estimated.
using RelativePoses = std::map<bool, KnownRelativePoses>;

// Prepares a group for hypotheses, once for those that share it.
class Preparations {
 public:
  // Uses and adds to the relative poses that are known.
  Preparations(const QueryGroup& group, const LocalizerOptions& options, RelativePoses* known,
               StageTimer::Seconds* seconds)
      : group_(group), options_(options), known_(known), seconds_(seconds) {}

  // Returns a reference that stays valid.
  const Prepared& For(const Hypothesis& hypothesis);

 private:
  // Returns the group with the pairs of a hypothesis.
  const QueryGroup& GroupOf(const Hypothesis& hypothesis);
  Layout LayoutOf(const QueryGroup& group) const;
  Prepared Prepare(const Hypothesis& hypothesis);

  const QueryGroup& group_;
  const LocalizerOptions& options_;
  RelativePoses* const known_;
  StageTimer::Seconds* const seconds_;
  std::map<std::string, QueryGroup> groups_of_one_pair_;  // by database image
  std::list<std::pair<Hypothesis, Prepared>> prepared_;
};

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/prepare.h"

#include <algorithm>
#include <vector>

#include "colmap_lazyloc/noise/database_pose_errors.h"

namespace lazyloc {
namespace {

// Throws Failure for frames without keypoints or without matches.
void CheckInput(const QueryGroup& group) {
  const int num_frames = static_cast<int>(group.frame_names.size());
  std::vector<bool> has_keypoints(num_frames, false), has_pairs(num_frames, false);
  for (const QueryImage& query : group.images) {
    if (!query.problem.query_keypoints.empty()) has_keypoints[query.frame] = true;
    if (!query.problem.pairs.empty()) has_pairs[query.frame] = true;
  }
  for (const QueryPair& pair : group.query_pairs) {
    // A frame may be linked to the database by another frame.
    const int frame = group.images[pair.query].frame, other_frame = group.images[pair.other].frame;
    if (num_frames > 1) has_pairs[frame] = has_pairs[other_frame] = true;
  }
  CheckFrames(num_frames, QueryStatus::NO_FEATURES,
              [&](int frame) { return has_keypoints[frame] ? Reason() : Reason("the query has no keypoints"); });
  CheckFrames(num_frames, QueryStatus::NO_PAIRS, [&](int frame) {
    return has_pairs[frame] ? Reason() : Reason("no posed database image shares matches with the query");
  });
}

void KeepPairWith(const std::string& database_name, std::vector<ImagePair>* pairs) {
  const auto is_other = [&](const ImagePair& pair) { return pair.other_name != database_name; };
  pairs->erase(std::remove_if(pairs->begin(), pairs->end(), is_other), pairs->end());
}

}  // namespace

const Prepared& Preparations::For(const Hypothesis& hypothesis) {
  for (const auto& [other, prepared] : prepared_) {
    if (hypothesis.estimates_focal_length == other.estimates_focal_length &&
        hypothesis.only_database_image == other.only_database_image) {
      return prepared;
    }
  }
  return prepared_.emplace_back(hypothesis, Prepare(hypothesis)).second;
}

const QueryGroup& Preparations::GroupOf(const Hypothesis& hypothesis) {
  const std::string& only_database_image = hypothesis.only_database_image;
  if (only_database_image.empty()) return group_;
  const auto [entry, is_new] = groups_of_one_pair_.try_emplace(only_database_image, group_);
  if (is_new) KeepPairWith(only_database_image, &entry->second.images.front().problem.pairs);
  return entry->second;
}

Layout Preparations::LayoutOf(const QueryGroup& group) const {
  for (const auto& [hypothesis, prepared] : prepared_) {
    if (&prepared.group == &group) return prepared.layout;
  }
  Layout layout = MakeLayout(group);
  if (options_.post_optimization == PostOptimization::TRACKS) {
    const StageTimer timer("database_poses", seconds_);
    layout.expected_pose_errors = MeasurePoseErrors(group, options_);
  }
  return layout;
}

Prepared Preparations::Prepare(const Hypothesis& hypothesis) {
  const QueryGroup& group = GroupOf(hypothesis);
  Prepared prepared{group, {}, {}};
  KnownRelativePoses* known = &(*known_)[hypothesis.estimates_focal_length];
  try {
    CheckInput(group);
    prepared.layout = LayoutOf(group);
    prepared.estimates = hypothesis.estimates_focal_length
                             ? FindInliers(group, prepared.layout, options_, known, seconds_)
                             : EstimatePairs(group, prepared.layout, options_, known, seconds_);
  } catch (const Failure& failure) {
    prepared.failure = failure;
  }
  return prepared;
}

}  // namespace lazyloc

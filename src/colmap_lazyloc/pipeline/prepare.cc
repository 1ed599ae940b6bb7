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

}  // namespace

const Prepared& Preparations::For(const Hypothesis& hypothesis, const LocalizerOptions& options,
                                  KnownRelativePoses* known, StageTimer::Seconds* seconds) {
  const Prepared* with_same_pairs = nullptr;
  for (const auto& [other, prepared] : prepared_) {
    if (hypothesis.only_database_image != other.only_database_image) continue;
    if (hypothesis.estimates_focal_length == other.estimates_focal_length) return prepared;
    with_same_pairs = &prepared;
  }
  if (!with_same_pairs && !hypothesis.only_database_image.empty()) {
    group_of_one_pair_ = group_;
    std::vector<ImagePair>& pairs = group_of_one_pair_.images.front().problem.pairs;
    const auto is_other = [&](const ImagePair& pair) { return pair.other_name != hypothesis.only_database_image; };
    pairs.erase(std::remove_if(pairs.begin(), pairs.end(), is_other), pairs.end());
  }
  const QueryGroup& group = hypothesis.only_database_image.empty() ? group_ : group_of_one_pair_;
  Prepared& prepared = prepared_.emplace_back(hypothesis, Prepared{group, {}, {}}).second;
  try {
    CheckInput(group);
    prepared.layout = with_same_pairs ? with_same_pairs->layout : MakeLayout(group);
    if (!with_same_pairs && options.method == Method::EXTENDED) {
      prepared.layout.expected_pose_errors =
          Timed("database_poses", seconds, [&] { return MeasurePoseErrors(group, options); });
    }
    prepared.estimates =
        EstimatePairs(group, prepared.layout, !hypothesis.estimates_focal_length, options, known, seconds);
  } catch (const Failure& failure) {
    prepared.failure = failure;
  }
  return prepared;
}

}  // namespace lazyloc

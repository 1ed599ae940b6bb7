#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Thrown when frames cannot be localized.
struct Failure {
  QueryStatus cause;
  std::string reason;
  std::vector<int> frames = {};                           // indices of the frames; empty means the whole group
  std::map<int, PartialPose> partial_poses = {};          // by query, if the rotation is known
  std::vector<std::optional<double>> rig_errors_px = {};  // by query, if they were measured
  std::map<int, std::string> reasons = {};                // of frames that have one of their own

  void Add(int frame, const std::string& reason_of_frame) {
    reason = reason_of_frame;
    reasons[frame] = reason_of_frame;
    frames.push_back(frame);
  }
  const std::string& ReasonOf(int frame) const {
    const auto own = reasons.find(frame);
    return own == reasons.end() ? reason : own->second;
  }
};

using Reason = std::optional<std::string>;

// Throws a failure of those of the frames 0 to num_frames - 1 that `reason_of(frame)` has a reason for, if any.
template <typename ReasonOf>
void CheckFrames(int num_frames, QueryStatus cause, const ReasonOf& reason_of) {
  Failure failure{cause, ""};
  for (int frame = 0; frame < num_frames; ++frame) {
    if (const Reason reason = reason_of(frame)) failure.Add(frame, *reason);
  }
  if (!failure.frames.empty()) throw failure;
}

}  // namespace lazyloc

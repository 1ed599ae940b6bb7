#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/uncertainty/pose_uncertainty.h"

namespace lazyloc {

// What the check of the intrinsics finds.
struct CheckedIntrinsics {
  std::vector<IntrinsicsResult> results;  // by query
  PosedImages posed;                      // as reported
  std::vector<PoseDistribution> poses;    // by query, around the layout's origin
  // By query: the camera that belongs to the pose; nullopt if it is the given one.
  std::vector<std::optional<Camera>> cameras;
  std::vector<IntrinsicsInformation> information;  // by query, of corrections of its camera
};

// Tests the intrinsics of each query by the scores of the last adjustment, judges them (intrinsics_judgement.h), and
// adds their uncertainty to that of the poses.
CheckedIntrinsics CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                  std::vector<PoseDistribution> poses, const LocalizerOptions& options);

}  // namespace lazyloc

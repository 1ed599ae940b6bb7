#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

namespace lazyloc {

// What the check of the intrinsics finds.
struct CheckedIntrinsics {
  std::vector<IntrinsicsResult> results;       // by query
  std::vector<PoseUncertainty> uncertainties;  // by query; with what the images leave open of the intrinsics
  PosedImages posed;                           // as reported
  // By query: the camera that belongs to the pose; nullopt if it is the given one.
  std::vector<std::optional<Camera>> cameras;
};

// Tests the intrinsics of each query by the scores of the last adjustment (intrinsics_estimate.h), judges them
// (intrinsics_judgement.h), and adds their uncertainty to that of the poses. camera: of a query whose focal length was
// estimated; else null.
CheckedIntrinsics CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                  std::vector<PoseUncertainty> uncertainties, const LocalizerOptions& options,
                                  const QueryCamera* camera = nullptr);

// Adds a focal length's uncertainty to that of a pose, and notes it in `intrinsics`, whose derivative is set.
void AddFocalLengthUncertainty(double mean_square, const Rigid3d& cam_from_world, IntrinsicsResult* intrinsics,
                               PoseUncertainty* uncertainty);

// Throws Failure for the frames with contradicted intrinsics.
void RefuseContradicted(const Layout& layout, const std::vector<IntrinsicsResult>& intrinsics);

}  // namespace lazyloc

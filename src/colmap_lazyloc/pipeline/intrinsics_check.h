#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

namespace lazyloc {

// What the error of a focal length does to a pose.
struct FocalLengthError {
  double mean_square = 0;  // expected square of the error of the log focal length that the covariance contains
  // Derivative of the tangent of cam_from_world with respect to the log focal length.
  Eigen::Matrix<double, 6, 1> pose_from_log_focal = Eigen::Matrix<double, 6, 1>::Zero();
};

// What the check of the intrinsics finds.
struct CheckedIntrinsics {
  std::vector<IntrinsicsResult> results;       // by query
  std::vector<FocalLengthError> focal_errors;  // by query
  std::vector<PoseUncertainty> uncertainties;  // by query; with what the images leave open of the intrinsics
  PosedImages posed;                           // as reported
  // Camera of each query that belongs to the pose; nullopt if it is the given one.
  std::vector<std::optional<Camera>> cameras;
};

// Tests the intrinsics of each query by the scores of the last adjustment (intrinsics_estimate.h), judges them
// (intrinsics_judgement.h), and adds their uncertainty to that of the poses. camera: of a query whose focal length was
// estimated; else null.
CheckedIntrinsics CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                  std::vector<PoseUncertainty> uncertainties, const LocalizerOptions& options,
                                  const QueryCamera* camera = nullptr);

// Adds what a focal length's error does to a pose to the pose's uncertainty.
void AddFocalLengthUncertainty(const FocalLengthError& error, const Rigid3d& cam_from_world,
                               PoseUncertainty* uncertainty);

}  // namespace lazyloc

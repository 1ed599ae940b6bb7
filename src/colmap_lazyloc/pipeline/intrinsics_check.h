#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"

namespace lazyloc {

// What a given focal length and an estimate by the images say together.
struct FocalLengthJudgement {
  double wrong_probability = 0;  // that the given value is wrong: off by more than a calibration is
  double mean_square = 0;        // expected square of the log of its error
};

// Judges a focal length by the log of the factor that the images ask for and its standard deviation. A value is right
// with some probability, which depends on its origin, and then off as calibrations are; else off by tens of percent.
FocalLengthJudgement JudgeFocalLength(double log_factor, double stddev, IntrinsicsOrigin origin,
                                      const LocalizerOptions& options);

// Adds a focal length's uncertainty to that of a pose, and notes it in `intrinsics`, whose derivative is set.
void AddFocalLengthUncertainty(double mean_square, const Rigid3d& cam_from_world, IntrinsicsResult* intrinsics,
                               PoseUncertainty* uncertainty);

// Tests the intrinsics of each query by the scores of the last adjustment, and adds their uncertainty to
// `uncertainties`. Where nobody has calibrated a camera, moves the pose in `reported` (the adjusted images) by the
// principal point, aspect ratio and distortion that the images ask for. camera: of a query whose focal length was
// estimated; else null.
std::vector<IntrinsicsResult> CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                              const LocalizerOptions& options,
                                              std::vector<PoseUncertainty>* uncertainties, PosedImages* reported,
                                              const QueryCamera* camera = nullptr);

// Throws Failure for the frames with contradicted intrinsics.
void RefuseContradicted(const Layout& layout, const std::vector<IntrinsicsResult>& intrinsics);

// Returns the sentence that names the given focal length and the one that the images ask for.
std::string FocalLengthContradiction(const Camera& camera, double factor, double factor_stddev);

}  // namespace lazyloc

#pragma once

#include <string>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Standard deviation of the log focal length above which the images cannot tell whether a value is right.
inline constexpr double kMaxObservableStddev = 0.02;

// The corrections of a query's intrinsics that the images suggest.
struct IntrinsicsEstimate {
  // All together: in their units; over their standard deviations.
  Eigen::Matrix<double, kNumTestedIntrinsics, 1> corrections, sigmas;
  double log_focal_factor = 0, log_focal_stddev = 0;
  double common_error_factor = 1;  // in the variances
};

// What a given focal length and an estimate by the images say together.
struct FocalLengthJudgement {
  double wrong_probability = 0;  // that the given value is wrong: off by more than measured ones are
  double mean_square = 0;        // expected square of the log of its error
};

// Judges a focal length by the log of the factor that the images suggest and its standard deviation. A value is right
// with some probability, which depends on its origin, and then off by tenths of a percent; else off by tens of percent.
FocalLengthJudgement JudgeFocalLength(double log_factor, double stddev, IntrinsicsOrigin origin,
                                      const LocalizerOptions& options);

// Sets the verdict and the contradiction. is_refined: true if the focal length was estimated. Returns the expected
// square of the error of the log focal length that the covariance lacks.
double JudgeIntrinsics(const Camera& camera, const IntrinsicsEstimate& estimate, bool is_refined,
                       const LocalizerOptions& options, IntrinsicsResult* result);

// Returns the sentence that names the focal length of a camera, by its origin, and the one that the images suggest.
std::string FocalLengthContradiction(const Camera& camera, const IntrinsicsResult& result);

}  // namespace lazyloc

#pragma once

#include <string>

#include "colmap_lazyloc/group/options.h"
#include "colmap_lazyloc/intrinsics/intrinsics_estimate.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Standard deviation of the log focal length above which the images cannot tell whether a value is right.
inline constexpr double kMaxObservableStddev = 0.02;

// What a given focal length and an estimate by the images say together.
struct FocalLengthJudgement {
  double wrong_probability = 0;  // that the given value is wrong: off by more than measured ones are
  double mean_square = 0;        // expected square of the log of its error
};

// Judges a focal length by the log of the factor that the images suggest and its standard deviation. A value is right
// with some probability, which depends on its origin, and then off by tenths of a percent; else off by tens of percent.
FocalLengthJudgement JudgeFocalLength(double log_factor, double stddev, IntrinsicsOrigin origin,
                                      const LocalizerOptions& options);

// Sets the verdict on intrinsics that were taken as given, and the contradiction.
void JudgeGiven(const Camera& camera, const IntrinsicsEstimate& estimate, const FocalLengthJudgement& focal_length,
                IntrinsicsResult* result);
// Sets the verdict on intrinsics whose focal length was estimated, and the contradiction of the others.
void JudgeRefined(const Camera& camera, const IntrinsicsEstimate& estimate, IntrinsicsResult* result);

// Returns the sentence that names the given focal length and the one that the images suggest.
std::string FocalLengthContradiction(const Camera& camera, double factor, double factor_stddev);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Factor on the variances of a score, because errors common to all database images, as of rolling shutters, pretend
// other intrinsics without making the images disagree.
inline constexpr double kCommonErrorFactor = 4;

inline constexpr int kNumOthers = NUM_INTRINSICS_PARAMETERS - 1;  // corrections but the first, the focal length's

// The corrections of a query's intrinsics that the images suggest.
struct IntrinsicsEstimate {
  IntrinsicsScore::Vector corrections, sigmas;  // all together: in their units; over their standard deviations
  double log_focal_factor = 0, log_focal_stddev = 0;
};

// Returns the covariance of a query frame's score, with the variances that the adjustment shows and the errors that
// images share.
IntrinsicsScore::Matrix ScoreCovariance(const Refined& refined, int frame);

IntrinsicsEstimate EstimateIntrinsics(const IntrinsicsScore& score, const IntrinsicsScore::Matrix& score_covariance);

}  // namespace lazyloc

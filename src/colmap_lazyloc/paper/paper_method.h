#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/initialization/motion_averaging.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// The noise of keypoints in pixels that the paper's method takes for granted, in all images alike.
inline constexpr double kPaperNoisePx = 1;
// Maximum reprojection error of an observation after adjustment, COLMAP's default.
inline constexpr double kMaxPaperErrorPx = 4;

struct PaperPose {
  Averaged averaged;  // before adjustment, with the pairs in use
  Refined refined;    // after it
};

// Localizes a single query by the method of the paper (LazyLoc, arXiv 2307.09981, section 3), without anything that the
// project adds: one start, one adjustment, exact database poses and intrinsics, the same noise in all images. The
// default method is compared with it. Throws Failure if a stage fails.
PaperPose LocalizeByPaper(const QueryGroup& group, const Layout& layout, const PairEstimates& estimates,
                          const LocalizerOptions& options, StageTimer::Seconds* seconds);

// Runs its first stages (sections 3.1 and 3.2): rotations by L1 and IRLS, then translations by angular errors. Leaves
// the pairs whose rotation agrees with the averaged one, because the paper uses no others. Throws Failure if there is
// no pose.
Averaged AverageAgreeing(const Layout& layout, const std::vector<PairGeometry>& pairs, const LocalizerOptions& options,
                         StageTimer::Seconds* seconds, const AveragingMethods& methods = {});

// Runs its last stage, the post optimization (section 3.3), on averaged poses: tracks, COLMAP's triangulation, Ceres'
// bundle adjustment with constant database cameras. The covariances are those of keypoint noise at its minimum.
Refined AdjustByPaper(const QueryGroup& group, const Layout& layout, const Averaged& averaged,
                      StageTimer::Seconds* seconds);

}  // namespace lazyloc

#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/averaged.h"
#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"

namespace lazyloc {

// An adjusted frame and what its position rests on.
struct AdjustedFrame {
  const Layout& layout;
  const PairRefs& pairs;
  const BundleAdjustmentResult& adjustment;
  int frame = 0;
  const TrackRefs& tracks;     // those that the frame observes
  double variance_factor = 1;  // multiplies the adjustment's covariances
  // False if matches and priors do not exclude the other orientation that points of one plane leave beside a single
  // database image; nullopt if they were not compared (plane_orientation.h).
  std::optional<bool> has_one_orientation = {};
};

// Return the number of tracks observed from at least three distinct centres, and of tracks with a depth.
int CountCommonTracks(const PosedImages& posed, const TrackRefs& tracks);
int CountTracksWithDepth(const PosedImages& posed, const TrackRefs& tracks);

// Returns true if depths decide about a distance that nothing else determines.
bool FixDistance(const PosedImages& posed, const TrackRefs& tracks);

// Returns true if the pose is unobservable: the standard deviation of its rotation exceeds 0.1 rad or that of its
// position max_position_stddev_ratio of the scene distance, or all centres are collinear and too few tracks have three
// images. With a position prior in the adjustment, the covariance shows how certain the position is, and only the
// rotation may be unobservable.
//
//      o-----o-----o-----q     database centres o and query q on one line: each pair tells the direction of the line
//       \   /                  only; a point that two database images see apart fixes the place on it
//         x
//
// With enough depths, the place on a line is known too, and the covariance tells how well.
bool IsPositionUnobservable(const AdjustedFrame& frame, const LocalizerOptions& options);

// Returns the failure of an adjusted frame whose position is unobservable: it names the reason, and has what is known
// of the pose.
Failure UnobservablePositionFailure(const AdjustedFrame& frame);

// Throws Failure for frames of one image with several database images, all of one place, and no other queries, because
// no two of these images triangulate a point; not if there are depth maps. Its partial pose has the rotation and
// bearing of motion averaging.
void CheckPlaces(const Layout& layout, const Averaged& averaged);

// Throws Failure for query frames without a baseline: as far as matches show, all photos were taken from one place, and
// the rotation is all that is known. has_baseline: by frame, at least for the query frames.
void CheckBaselines(const Layout& layout, const Averaged& averaged, const std::vector<bool>& has_baseline);

}  // namespace lazyloc

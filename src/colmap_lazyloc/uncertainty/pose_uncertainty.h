#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

inline constexpr char kUnknownFocalLengthReason[] =
    "the images do not determine the focal length, which nobody has stated: it cannot be told apart from the distance "
    "to the scene";

// Returns the distribution of a query's pose, with the variances of image noise and database poses that the adjustment
// shows instead of those that it took for granted. cam_from_world: the pose as reported.
PoseDistribution DistributionOf(const Refined& refined, int query, const Rigid3d& cam_from_world);

// Returns the distributions of the queries' poses by the last adjustment: image noise and the noise of database poses,
// both scaled by how well the tracks and the priors fit. Throws Failure for frames with too few tracks or an
// unobservable position, and says why it is unobservable.
std::vector<PoseDistribution> EstimateUncertainties(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                                                    const LocalizerOptions& options);

}  // namespace lazyloc

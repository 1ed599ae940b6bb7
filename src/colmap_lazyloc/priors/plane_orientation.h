#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Points of one plane leave two poses of a query beside a single database image (Longuet-Higgins, "The reconstruction
// of a plane surface from two perspective projections", 1986). Returns the other one, at the same distance from that
// image; nullopt if the points do not lie in front of both cameras there. The plane is fitted to the tracks' points.
std::optional<Rigid3d> OtherOrientation(const Rigid3d& query_from_world, const Rigid3d& database_from_world,
                                        const TrackRefs& tracks);

// Returns the sum of the squared errors of matches of a query and a database image, truncated at three standard
// deviations: distances from the epipolar lines, or, for points that would lie behind a camera, the parallax.
double SumSquaredErrors(const Rigid3d& query_from_database, const std::vector<Track>& matches, double noise_px);

// Returns the median distance from the epipolar lines as a standard deviation.
double EpipolarNoisePx(const Rigid3d& query_from_database, const std::vector<Track>& matches);

// Compares the refined pose of a single query beside a single database image with `other`, the pose that was refined
// from its other orientation, by the matches and the query's priors. Returns how much better the first one fits, in
// squared standard deviations (negative: the other one fits better); nullopt if both are the same pose.
std::optional<double> CompareOrientations(const Layout& layout, const PairRefs& pairs,
                                          const std::vector<Track>& matches, const Refined& refined,
                                          const Refined& other);

}  // namespace lazyloc

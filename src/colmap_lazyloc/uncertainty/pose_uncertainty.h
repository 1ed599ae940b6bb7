#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Uncertainty of a query's pose.
struct PoseUncertainty {
  // Covariance of cam_from_world in the database's coordinates: rotation (rad), then translation (database units).
  Eigen::Matrix<double, 6, 6> covariance;
  PoseSpread spread;
};

// Returns the derivative of a pose's tangent by that of the same pose in coordinates around `origin`, with which
// t = t_around_origin - R origin.
Eigen::Matrix<double, 6, 6> TangentFromAround(const Eigen::Vector3d& origin, const Eigen::Quaterniond& rotation);
// Returns the covariance of a pose from that in coordinates around `origin`.
Eigen::Matrix<double, 6, 6> CovarianceFromAround(const Eigen::Vector3d& origin, const Eigen::Quaterniond& rotation,
                                                 const Eigen::Matrix<double, 6, 6>& covariance);

// Returns the covariance of a query's cam_from_world around the layout's origin, with the variances of image noise and
// database poses that the adjustment shows instead of those that it took for granted.
Eigen::Matrix<double, 6, 6> TotalCovariance(const Refined& refined, int query);

// Returns the uncertainties of the queries from the last adjustment: image noise and the noise of database poses, both
// scaled by how well the tracks and the priors fit. Throws Failure for frames with too few tracks or an unobservable
// position, and says why it is unobservable.
std::vector<PoseUncertainty> EstimateUncertainties(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                                                   const LocalizerOptions& options);

}  // namespace lazyloc

#include "colmap_lazyloc/database/two_view_orientation.h"

#include <cmath>

#include <Eigen/LU>

namespace lazyloc {
namespace {

double RoundedToGrid(double value) {
  constexpr double kStepsPerUnit = 8589934592.0;                       // 2^33
  return std::nearbyint(value * kStepsPerUnit) / kStepsPerUnit + 0.0;  // + 0.0 turns -0 into 0
}

bool IsFirstNonZeroNegative(const Eigen::Vector4d& wxyz) {
  for (const double value : wxyz) {
    if (value != 0) return value < 0;
  }
  return false;
}

}  // namespace

TwoViewGeometry Inverted(const TwoViewGeometry& geometry) {
  TwoViewGeometry inverted;
  inverted.config = geometry.config;
  inverted.inlier_matches.reserve(geometry.inlier_matches.size());
  for (const Match& match : geometry.inlier_matches) {
    inverted.inlier_matches.push_back({match.other_point, match.query_point});
  }
  if (geometry.query_from_other) inverted.query_from_other = Inverse(*geometry.query_from_other);
  if (geometry.E) inverted.E = geometry.E->transpose();
  if (geometry.F) inverted.F = geometry.F->transpose();
  if (geometry.H) {
    const Eigen::Matrix3d other_from_query = geometry.H->inverse();
    if (other_from_query.allFinite()) inverted.H = other_from_query;
  }
  inverted.query_camera = geometry.other_camera;
  inverted.other_camera = geometry.query_camera;
  return inverted;
}

Rigid3d CanonicalRelativePose(const Rigid3d& cam2_from_cam1) {
  const Eigen::Quaterniond rotation = cam2_from_cam1.rotation.normalized();
  Eigen::Vector4d wxyz(rotation.w(), rotation.x(), rotation.y(), rotation.z());
  wxyz = wxyz.unaryExpr(&RoundedToGrid);
  // Chooses the sign after rounding, so that it does not depend on a w of a few 1e-17.
  if (IsFirstNonZeroNegative(wxyz)) wxyz = (-wxyz).unaryExpr(&RoundedToGrid);
  const Eigen::Vector3d direction = cam2_from_cam1.translation.stableNormalized();
  return {{wxyz(0), wxyz(1), wxyz(2), wxyz(3)}, direction.unaryExpr(&RoundedToGrid)};
}

}  // namespace lazyloc

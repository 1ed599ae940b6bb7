#include "colmap_lazyloc/bridge/convert.h"

namespace lazyloc {

std::optional<Rigid3d> RelativePose(const colmap::TwoViewGeometry& geometry) {
  const colmap::Rigid3d& pose = geometry.cam2_from_cam1;
  if (!pose.rotation.coeffs().allFinite() || pose.rotation.norm() == 0 || !pose.translation.allFinite()) {
    return std::nullopt;
  }
  return Rigid3d{pose.rotation.normalized(), pose.translation};
}

}  // namespace lazyloc

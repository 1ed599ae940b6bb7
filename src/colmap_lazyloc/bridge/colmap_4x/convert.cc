#include "colmap_lazyloc/bridge/convert.h"

namespace lazyloc {

std::optional<Rigid3d> RelativePose(const colmap::TwoViewGeometry& geometry) {
  const std::optional<colmap::Rigid3d>& pose = geometry.cam2_from_cam1;
  if (!pose || !pose->params.allFinite()) return std::nullopt;
  return Rigid3d{pose->rotation().normalized(), pose->translation()};
}

}  // namespace lazyloc

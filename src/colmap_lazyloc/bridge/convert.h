#pragma once

#include <optional>

#include <colmap/feature/types.h>
#include <colmap/scene/camera.h>
#include <colmap/scene/two_view_geometry.h>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

inline colmap::Camera ToColmap(const Camera& camera) {
  colmap::Camera converted;
  converted.camera_id = camera.camera_id;
  converted.model_id = static_cast<colmap::CameraModelId>(camera.model_id);
  converted.width = camera.width;
  converted.height = camera.height;
  converted.params = camera.params;
  // Our intrinsics are known: COLMAP takes a camera without prior for uncalibrated.
  converted.has_prior_focal_length = true;
  return converted;
}

// COLMAP's first image is the database's, its second one the query's.
inline colmap::FeatureMatches ToColmap(const Matches& matches) {
  colmap::FeatureMatches converted;
  converted.reserve(matches.size());
  for (const Match& match : matches) converted.emplace_back(match.database_point, match.query_point);
  return converted;
}

// None where COLMAP has set no pose, or one that is not finite.
std::optional<Rigid3d> RelativePose(const colmap::TwoViewGeometry& geometry);

}  // namespace lazyloc

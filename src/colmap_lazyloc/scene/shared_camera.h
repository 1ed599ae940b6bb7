#pragma once

#include <cstdint>
#include <vector>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/intrinsics_parameter.h"

namespace lazyloc {

// A camera that several queries share, estimated from these queries.
struct SharedCamera {
  Camera given;  // the same for all queries
  Camera camera;
  IntrinsicsCovariance covariance = IntrinsicsCovariance::Zero();  // of `camera`
  int num_queries = 0;                                             // that it was estimated from
  uint32_t database_id = 0;  // of the camera in the database; 0 if queries share it by their size
};
using SharedCameras = std::vector<SharedCamera>;

// Returns the estimate for a query with a given camera; null if there is none. cameras: may be null.
inline const SharedCamera* FindSharedCamera(const SharedCameras* cameras, const Camera& given,
                                            IntrinsicsOrigin origin) {
  if (cameras == nullptr || IsOfThisCamera(origin)) return nullptr;
  for (const SharedCamera& shared : *cameras) {
    if (SameIntrinsics(shared.given, given)) return &shared;
  }
  return nullptr;
}

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/scene/shared_camera.h"

namespace lazyloc {

// What the queries of a group are tried with.
struct Attempt {
  int num_retrieved = 20;               // database images per query
  bool only_near = false;               // photos: only database images near their position, if it tells enough
  bool compares_all_features = false;   // of photos; false: the largest first, then more along epipolar lines
  bool uses_fallback_features = false;  // of photos; false: those of the database
  bool writes_matches = false;          // of photos, to --LazyLocalizer.Advanced.matches_output_path
  bool only_unknown_cameras = false;    // refuse a query whose camera is known, before its features are computed
  // Cameras that replace those of queries whose intrinsics nobody has stated; null: none.
  const SharedCameras* shared_cameras = nullptr;
};

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "colmap_lazyloc/scene/joint_scene.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

// Intrinsics that photos of an epoch share.
struct EpochCamera : JointCamera {  // constant: a camera of the database images, or calibrated before
  int num_photos = 0;               // that have it and a pose
};

// New photo of an epoch.
struct EpochPhoto {
  QueryRecord record;                   // its pose is adjusted in place
  std::optional<uint32_t> database_id;  // nullopt if the database has no keypoints of it
  PoseDistribution localized;           // before adjustment
  std::optional<QueryRecord> refused;   // what the database says of a photo that hangs on others
  int num_hangings = 0;                 // how often others have placed the photo
  int camera = -1;                      // index of an EpochCamera
  bool is_placed = false;               // true if it has a pose that is adjusted with the others

  const std::string& Name() const { return record.result.query_name; }
  const Rigid3d& Pose() const { return record.result.cam_from_world; }
};

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/epoch/epoch_photo.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Gives each photo a camera, and returns the cameras. A photo that was localized with the intrinsics of a camera of the
// model, or with given ones, has this camera, which is constant. Others share one if the database states the same
// intrinsics for them, or with `shares` 0 each have their own; its first value is the median of what they were
// localized with. A shared camera that a single photo has determined is constant. A photo without a pose has the camera
// of the first photo with a pose for which the database states the same.
std::vector<EpochCamera> ChooseCameras(const Model& model, const DatabaseReader& database, bool shares,
                                       std::vector<EpochPhoto>* photos);

}  // namespace lazyloc

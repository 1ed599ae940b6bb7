#pragma once

#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/epoch/epoch_photo.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Gives each photo a camera, and returns the cameras. A photo that was localized with the intrinsics of a camera of the
// model has this camera. Others share one if the database states the same intrinsics for them, or with `shares` 0 each
// have their own; its first value is the median of what they were localized with.
std::vector<EpochCamera> ChooseCameras(const Model& model, const DatabaseReader& database, bool shares,
                                       std::vector<EpochPhoto>* photos);

}  // namespace lazyloc

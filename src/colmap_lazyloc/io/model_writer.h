#pragma once

#include <filesystem>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/io/model_merger.h"

namespace lazyloc {

// Writes cameras.bin, images.bin and points3D.bin, as every COLMAP since 3.6 reads them, into an existing folder.
// Images get their points, one for each keypoint of the database, where a database_id is given, else none; keypoints
// are read one image at a time. A model with rigs gets rigs.bin and frames.bin too, which COLMAP 3 does not look at;
// without them COLMAP 4 takes each image for a frame of its own.
// Throws InputError naming the file that cannot be written.
void WriteModel(const std::filesystem::path& folder, const MergedModel& model, const DatabaseReader& database);

}  // namespace lazyloc

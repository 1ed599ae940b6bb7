#pragma once

#include <filesystem>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/results/model_merger.h"

namespace lazyloc {

// Writes cameras.bin, images.bin and points3D.bin, which every COLMAP since 3.6 reads, into an existing folder.
// Localized queries and images that observe a point get all of their keypoints, which are read one image at a time. A
// model with rigs also gets rigs.bin and frames.bin, which COLMAP 3 ignores; without them COLMAP 4 makes each image a
// frame of its own. A model with an origin on Earth also gets geo.json. What is merged how: results/model_merger.h,
// results/point_merger.h. scratch_file: for observations that do not fit into memory; it stays. Throws InputError
// naming the file that cannot be written.
void WriteModel(const std::filesystem::path& folder, const std::filesystem::path& scratch_file, const Model& model,
                const QueryRecords& records, const DatabaseContent& database);

}  // namespace lazyloc

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/epoch/epoch_photo.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct HangingOptions {
  std::string database_path;
  double min_confidence = 0.9;
  int num_threads = -1;
  std::filesystem::path query_list;  // a file that may be written
};

// Localizes the photos without a pose against the database images and the photos that have one. A photo that is found
// gets its record, a pose, and the mark that it hangs on others. Returns how many were found.
int HangPhotos(const Model& model, const std::vector<EpochCamera>& cameras, const HangingOptions& options,
               std::vector<EpochPhoto>* photos);

}  // namespace lazyloc

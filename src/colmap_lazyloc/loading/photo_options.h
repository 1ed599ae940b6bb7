#pragma once

#include <cstddef>
#include <string>

#include "colmap_lazyloc/features/feature_methods.h"

namespace lazyloc {

struct PhotoOptions {
  std::string image_path;  // folder of the photos; empty: no query is a photo
  std::string camera_model = "SIMPLE_RADIAL";
  std::string camera_params;  // of all photos without a known camera; numbers separated by commas
  std::string retrieval_index_path;
  std::string matches_output_path;
  FeatureOptions features;
  std::string position_path;  // rough positions of photos, which only choose database images; empty: none
  bool on_demand = false;     // extract features of database images that the database does not have from their photos
  double cache_gb = 1;        // memory for the features of database images

  size_t CacheBytes() const;
  bool Check(std::string* error) const;
  // Returns false if files for photos are named although image_path is empty.
  bool CheckImagePath(std::string* error) const;
};

}  // namespace lazyloc

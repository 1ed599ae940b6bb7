#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/formats/depth_map_reader.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

struct DepthMapOptions {
  std::string depth_path;   // folder of the maps; empty: none
  double png_unit = 0.001;  // database units per value of a PNG

  bool Check(std::string* error) const;
};

// Returns the depth at a point in pixels of an image of this size; 0 if it is unknown, or if it jumps next to the
// point.
float DepthAt(const DepthMap& map, const Camera& camera, const Eigen::Vector2d& xy);

// Depth maps of database images, by the images' names. A map is read when its image is first used, and only the depths
// at the image's keypoints are kept, so that memory does not grow with the maps. Thread-safe.
class DepthMaps {
 public:
  // Throws InputError if the folder cannot be used.
  explicit DepthMaps(const DepthMapOptions& options);

  // Returns the depths at the keypoints of an image, 0 where unknown; empty if the image has no usable map.
  std::vector<float> AtKeypoints(const std::string& image_name, uint32_t image_id, const Camera& camera,
                                 const std::vector<Eigen::Vector2d>& keypoints) const;

  // Returns one line for each map that could not be used until now.
  std::vector<std::string> Problems() const;
  // Returns one line on all images that had no map until now; empty without any.
  std::string MissingMaps() const;

 private:
  struct Sampled {
    size_t keypoints_hash = 0;
    std::vector<float> depths;
  };

  std::filesystem::path FindFile(const std::string& image_name) const;
  Sampled Sample(const std::string& image_name, const Camera& camera,
                 const std::vector<Eigen::Vector2d>& keypoints) const;

  const DepthMapOptions options_;
  mutable LruCache<Sampled> cache_;
  mutable std::mutex problems_mutex_;
  mutable std::map<std::string, std::string> problem_of_image_;  // empty: there is no map
};

}  // namespace lazyloc

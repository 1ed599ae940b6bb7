#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <unordered_map>
#include <unordered_set>

#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Collects a model while it is read, and refuses impossible parts of it in either format.
class ModelBuilder {
 public:
  // Return why the part was refused; empty if it was added. Cameras come first, then rigs, frames and images.
  std::string AddCamera(Camera camera);
  std::string AddRig(Rig rig);
  std::string AddFrame(ModelFrame frame);
  std::string AddImage(ModelImage image);

  // Returns the model with its images sorted by name. The builder is empty afterwards.
  Model Take();

 private:
  Model model_;
  std::unordered_map<uint64_t, uint32_t> camera_of_framed_image_;
  std::unordered_set<uint32_t> image_ids_;
  std::unordered_set<std::string> names_;
};

// Read one file each of COLMAP's two formats. They throw InputError naming the file, and in text files the line.
void ReadCamerasBinary(const std::filesystem::path& path, ModelBuilder* builder);
void ReadRigsBinary(const std::filesystem::path& path, ModelBuilder* builder);
void ReadFramesBinary(const std::filesystem::path& path, ModelBuilder* builder);
void ReadImagesBinary(const std::filesystem::path& path, ModelBuilder* builder);
void ReadCamerasText(const std::filesystem::path& path, ModelBuilder* builder);
void ReadRigsText(const std::filesystem::path& path, ModelBuilder* builder);
void ReadFramesText(const std::filesystem::path& path, ModelBuilder* builder);
void ReadImagesText(const std::filesystem::path& path, ModelBuilder* builder);

}  // namespace lazyloc

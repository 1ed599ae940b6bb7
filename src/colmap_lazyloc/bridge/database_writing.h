#pragma once

#include <filesystem>
#include <memory>

#include <colmap/scene/database.h>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Opens a COLMAP database for writing; creates the file if it does not exist.
std::shared_ptr<colmap::Database> OpenDatabase(const std::filesystem::path& path);

bool CanWriteDescriptors(FeatureType type);
void WriteDescriptors(uint32_t image_id, const Features& features, colmap::Database* database);

// Write a rig of one camera, and a frame of one image, with the same id as the camera or image. They do nothing with
// COLMAP 3, which has neither rigs nor frames.
void WriteRigOf(const colmap::Camera& camera, colmap::Database* database);
void WriteFrameOf(const colmap::Image& image, colmap::Database* database);

}  // namespace lazyloc

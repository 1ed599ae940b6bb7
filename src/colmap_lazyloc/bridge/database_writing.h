#pragma once

#include <filesystem>
#include <memory>

#include <colmap/scene/database.h>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Opens a database, or makes a new one.
std::shared_ptr<colmap::Database> OpenDatabase(const std::filesystem::path& path);

void WriteSiftDescriptors(uint32_t image_id, const Descriptors& descriptors, colmap::Database* database);

// COLMAP 4 wants a rig of each camera, and a frame of each image, with the same ids; COLMAP 3 knows neither.
void WriteRigOf(const colmap::Camera& camera, colmap::Database* database);
void WriteFrameOf(const colmap::Image& image, colmap::Database* database);

}  // namespace lazyloc

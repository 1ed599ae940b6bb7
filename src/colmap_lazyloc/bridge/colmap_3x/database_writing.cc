#include "colmap_lazyloc/bridge/database_writing.h"

namespace lazyloc {

std::shared_ptr<colmap::Database> OpenDatabase(const std::filesystem::path& path) {
  return std::make_shared<colmap::Database>(path.string());
}

bool CanWriteDescriptors(FeatureType type) { return type == FeatureType::SIFT; }

void WriteDescriptors(uint32_t image_id, const Features& features, colmap::Database* database) {
  database->WriteDescriptors(image_id, features.descriptors);
}

void WriteRigOf(const colmap::Camera&, colmap::Database*) {}
void WriteFrameOf(const colmap::Image&, colmap::Database*) {}

}  // namespace lazyloc

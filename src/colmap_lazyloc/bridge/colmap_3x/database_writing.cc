#include "colmap_lazyloc/bridge/database_writing.h"

namespace lazyloc {

std::shared_ptr<colmap::Database> OpenDatabase(const std::filesystem::path& path) {
  return std::make_shared<colmap::Database>(path.string());
}

void WriteSiftDescriptors(uint32_t image_id, const Descriptors& descriptors, colmap::Database* database) {
  database->WriteDescriptors(image_id, descriptors);
}

void WriteRigOf(const colmap::Camera&, colmap::Database*) {}
void WriteFrameOf(const colmap::Image&, colmap::Database*) {}

}  // namespace lazyloc

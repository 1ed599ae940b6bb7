#include "colmap_lazyloc/database/image_labels.h"

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

ImageLabels::ImageLabels(const SqliteConnection& connection)
    : name_(connection.Prepare("images", "SELECT name FROM images WHERE image_id = ?1")) {}

std::string ImageLabels::Of(uint32_t image_id) const {
  std::string label = "image " + std::to_string(image_id);
  try {
    SqliteRows rows = name_.Run({image_id});
    if (rows.Next()) label += " (" + rows.Text(0) + ")";
  } catch (const DamagedRecordError&) {
    // The label is for a message about another record.
  }
  return label;
}

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <string>

#include "colmap_lazyloc/database/sqlite.h"

namespace lazyloc {

// Names images in messages. The connection must outlive it.
class ImageLabels {
 public:
  explicit ImageLabels(const SqliteConnection& connection);
  // Returns `image <id> (<name>)`, or `image <id>` if the name is unknown or damaged.
  std::string Of(uint32_t image_id) const;

 private:
  SqliteStatement name_;
};

}  // namespace lazyloc

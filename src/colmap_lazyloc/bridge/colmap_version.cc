#include "colmap_lazyloc/bridge/colmap_version.h"

#include <colmap/util/version.h>

namespace lazyloc {

std::string ColmapVersion() { return colmap::GetVersionInfo(); }

}  // namespace lazyloc

#pragma once

#include <string>

namespace lazyloc {

// Returns the name and version of the COLMAP that is linked, for example "COLMAP 3.10".
std::string ColmapVersion();

}  // namespace lazyloc

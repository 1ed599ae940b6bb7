#include "colmap_lazyloc/bridge/logging.h"

#include <colmap/util/logging.h>

namespace lazyloc {

void InitializeLogging(char** argv) { colmap::InitializeGlog(argv); }

}  // namespace lazyloc

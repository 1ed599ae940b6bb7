#include "colmap_lazyloc/bridge/logging.h"

#include <colmap/util/logging.h>

namespace lazyloc {

void InitializeLogging(char** argv) { colmap::InitializeGlog(argv); }

void SilenceLogging() { FLAGS_minloglevel = google::GLOG_FATAL; }

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/colmap_program.h"

#include <colmap/util/logging.h>
#include <colmap/util/version.h>

namespace lazyloc {

void InitializeLogging(char** argv) { colmap::InitializeGlog(argv); }

void SilenceLogging() { FLAGS_minloglevel = google::GLOG_FATAL; }

std::string ColmapVersion() { return colmap::GetVersionInfo(); }

}  // namespace lazyloc

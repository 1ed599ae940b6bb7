#pragma once

#include <string>

#include "colmap_lazyloc/cli/options.h"

namespace lazyloc {

// Returns the shell command that makes a report page of a finished run.
std::string ReportCommand(const CommandOptions& options);

// Returns the versions of this program and of COLMAP, for example "colmap_lazyloc 0.1.0, COLMAP 3.10".
std::string ProgramVersion();

}  // namespace lazyloc

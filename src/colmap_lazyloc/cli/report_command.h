#pragma once

#include <string>

#include "colmap_lazyloc/options/options.h"

namespace lazyloc {

// Prints the shell command that makes a report page of a finished run to the standard error output, if the program for
// it is installed. own_path: argv[0] of this program.
void PrintReportCommand(const std::string& own_path, const CommandOptions& options);

// Returns the word by which a shell finds `lazyloc`: its name if it is in a folder of PATH, or else its path if it is
// in the folder of this program, or in scripts/ of the checkout that has built this program; empty if it is in none.
std::string FindLazyloc(const std::string& own_path);

// Returns the shell command that makes a report page of a finished run. lazyloc: FindLazyloc.
std::string ReportCommand(const std::string& lazyloc, const CommandOptions& options);

}  // namespace lazyloc

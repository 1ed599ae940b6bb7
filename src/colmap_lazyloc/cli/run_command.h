#pragma once

#include <functional>
#include <string>

namespace lazyloc {

// Runs a command and returns its exit code. An exception becomes one line of the standard error output and exit code 1.
// From then on, a closed pipe does not end the program.
int RunCommand(const std::string& name, const std::function<int()>& command);

// Prints one line to the standard error output.
void PrintWarning(const std::string& warning);

}  // namespace lazyloc

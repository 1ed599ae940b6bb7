#pragma once

#include <functional>
#include <string>

namespace lazyloc {

// Runs a command and returns its exit code; what it throws becomes one line of the standard error output, and exit
// code 1.
int RunCommand(const std::string& name, const std::function<int()>& command);

}  // namespace lazyloc

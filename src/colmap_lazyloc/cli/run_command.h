#pragma once

#include <functional>
#include <string>

namespace lazyloc {

// Runs a command and returns its exit code. An exception becomes one line of the standard error output and exit code 1.
int RunCommand(const std::string& name, const std::function<int()>& command);

// Prints one line to the standard error output.
void PrintWarning(const std::string& warning);

// Replaces control characters by escape sequences (for example a newline by \n), because names from files may hold any.
std::string AsOneLine(const std::string& text);

}  // namespace lazyloc

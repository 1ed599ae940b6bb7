#include "colmap_lazyloc/cli/run_command.h"

#include <csignal>
#include <cstdlib>
#include <iostream>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {

int RunCommand(const std::string& name, const std::function<int()>& command) {
  // Goes on if whoever reads the output has seen enough: the results are in files.
  std::signal(SIGPIPE, SIG_IGN);
  try {
    return command();
  } catch (const InputError& error) {
    std::cerr << "ERROR: " << AsOneLine(error.what()) << std::endl;
  } catch (const std::exception& error) {
    std::cerr << "ERROR (a bug in " << name << ", please report it): " << AsOneLine(error.what()) << std::endl;
  }
  return EXIT_FAILURE;
}

void PrintWarning(const std::string& warning) { std::cerr << "WARNING: " << AsOneLine(warning) << std::endl; }

}  // namespace lazyloc

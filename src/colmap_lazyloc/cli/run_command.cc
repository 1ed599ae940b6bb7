#include "colmap_lazyloc/cli/run_command.h"

#include <cstdlib>
#include <iostream>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

int RunCommand(const std::string& name, const std::function<int()>& command) {
  try {
    return command();
  } catch (const InputError& error) {
    std::cerr << "ERROR: " << error.what() << std::endl;
  } catch (const std::exception& error) {
    std::cerr << "ERROR (a bug in " << name << ", please report it): " << error.what() << std::endl;
  }
  return EXIT_FAILURE;
}

}  // namespace lazyloc

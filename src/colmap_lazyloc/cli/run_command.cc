#include "colmap_lazyloc/cli/run_command.h"

#include <cstdlib>
#include <iostream>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

std::string AsOneLine(const std::string& text) {
  constexpr char kHexDigits[] = "0123456789abcdef";
  std::string line;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\n') {
      line += "\\n";
    } else if (byte < ' ' || byte == 0x7f) {
      line += {'\\', 'x', kHexDigits[byte / 16], kHexDigits[byte % 16]};
    } else {
      line += c;
    }
  }
  return line;
}

int RunCommand(const std::string& name, const std::function<int()>& command) {
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

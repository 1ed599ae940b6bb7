#pragma once

#include <stdexcept>
#include <string>

namespace lazyloc {

// Thrown if a file or an option of the user cannot be used. The message is one line that names it. The command prints
// it and ends with exit code 1 without any output.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace lazyloc

// Throws std::logic_error if the condition does not hold, because that is a bug in this program.
#define LAZYLOC_CHECK(condition) \
  (static_cast<bool>(condition) ? void(0) : throw std::logic_error(__FILE__ ": check failed: " #condition))

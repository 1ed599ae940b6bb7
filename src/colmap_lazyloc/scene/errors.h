#pragma once

#include <stdexcept>
#include <string>

namespace lazyloc {

// A file or an option that the user gave cannot be used. The message is one line that names it.
// The command prints it and ends with exit code 1, nothing written.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace lazyloc

// A broken precondition is a bug of ours.
#define LAZYLOC_CHECK(condition) \
  (static_cast<bool>(condition) ? void(0) : throw std::logic_error(__FILE__ ": check failed: " #condition))

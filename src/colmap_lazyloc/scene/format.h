#pragma once

#include <string>

namespace lazyloc {

// Returns text as std::printf writes it. The compiler compares the values with the format.
[[gnu::format(printf, 1, 2)]] std::string Format(const char* format, ...);

}  // namespace lazyloc

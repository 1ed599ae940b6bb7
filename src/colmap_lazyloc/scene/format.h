#pragma once

#include <string>

namespace lazyloc {

// Returns text as std::printf writes it. The compiler compares the values with the format.
[[gnu::format(printf, 1, 2)]] std::string Format(const char* format, ...);

// Replaces control characters by escape sequences (for example a newline by \n), because names from files may hold any.
std::string AsOneLine(const std::string& text);

}  // namespace lazyloc

#pragma once

#include <string>
#include <string_view>

namespace lazyloc {

// Returns text as std::printf writes it. The compiler compares the values with the format.
[[gnu::format(printf, 1, 2)]] std::string Format(const char* format, ...);

// Replaces control characters by escape sequences (for example a newline by \n), because names from files may hold any,
// and the middle of words of more than 1000 bytes by "...", because only damaged files have such words.
std::string AsOneLine(const std::string& text);

// Returns the text with each byte that is not part of UTF-8 as "\xNN", as Python's backslashreplace does. Names of
// files may have such bytes, but JSON must not.
std::string ValidUtf8(std::string_view text);

}  // namespace lazyloc

#pragma once

#include <string>
#include <string_view>

namespace lazyloc {

// Returns the text with each byte that is not part of UTF-8 as "\xNN", as Python's backslashreplace does. Names of
// files may have such bytes, but JSON must not.
std::string ValidUtf8(std::string_view text);

}  // namespace lazyloc

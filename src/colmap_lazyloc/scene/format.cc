#include "colmap_lazyloc/scene/format.h"

#include <cstdarg>
#include <cstdio>

namespace lazyloc {

std::string Format(const char* format, ...) {
  std::va_list values, again;
  va_start(values, format);
  va_copy(again, values);
  std::string text(std::vsnprintf(nullptr, 0, format, values), '\0');
  std::vsnprintf(text.data(), text.size() + 1, format, again);
  va_end(again);
  va_end(values);
  return text;
}

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

}  // namespace lazyloc

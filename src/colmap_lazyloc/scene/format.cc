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
  std::string line;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\n') {
      line += "\\n";
    } else if (byte < ' ' || byte == 0x7f) {
      line += Format("\\x%02x", byte);
    } else {
      line += c;
    }
  }
  return line;
}

}  // namespace lazyloc

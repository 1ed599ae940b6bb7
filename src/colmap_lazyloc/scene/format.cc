#include "colmap_lazyloc/scene/format.h"

#include <cstdarg>
#include <cstdio>

#include <boost/locale/utf.hpp>

namespace lazyloc {
namespace {

std::string Shortened(const std::string& word) {
  if (word.size() <= 1000) return word;
  return ValidUtf8(word.substr(0, 50)) + "..." + ValidUtf8(word.substr(word.size() - 10));
}

}  // namespace

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
  std::string line, word;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\n') {
      word += "\\n";
    } else if (byte < ' ' || byte == 0x7f) {
      word += Format("\\x%02x", byte);
    } else if (c == ' ') {
      line += Shortened(word) + c;
      word.clear();
    } else {
      word += c;
    }
  }
  return line + Shortened(word);
}

std::string ValidUtf8(std::string_view text) {
  namespace utf = boost::locale::utf;
  std::string valid;
  for (auto next = text.begin(); next != text.end();) {
    const auto begin = next;
    if (utf::is_valid_codepoint(utf::utf_traits<char>::decode(next, text.end()))) {
      valid.append(begin, next);
    } else {
      valid += Format("\\x%02x", static_cast<unsigned char>(*begin));
      next = begin + 1;
    }
  }
  return valid;
}

}  // namespace lazyloc

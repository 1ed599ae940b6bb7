#include "colmap_lazyloc/results/valid_utf8.h"

namespace lazyloc {
namespace {

unsigned char Byte(std::string_view text, size_t i) {
  return i < text.size() ? static_cast<unsigned char>(text[i]) : 0;
}

bool IsBetween(unsigned char byte, unsigned char first, unsigned char last) { return first <= byte && byte <= last; }

// Returns the length of the character at the beginning of the text, 0 if it is not UTF-8 (RFC 3629, section 4).
size_t CharacterLength(std::string_view text) {
  const unsigned char lead = Byte(text, 0);
  if (lead < 0x80) return 1;
  const size_t length = IsBetween(lead, 0xC2, 0xDF) ? 2 : IsBetween(lead, 0xE0, 0xEF) ? 3 : 4;
  if (!IsBetween(lead, 0xC2, 0xF4)) return 0;
  // Excludes encodings that are too long, surrogates, and numbers beyond Unicode.
  const unsigned char first = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
  const unsigned char last = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
  if (!IsBetween(Byte(text, 1), first, last)) return 0;
  for (size_t i = 2; i < length; ++i) {
    if (!IsBetween(Byte(text, i), 0x80, 0xBF)) return 0;
  }
  return length;
}

}  // namespace

std::string ValidUtf8(std::string_view text) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string valid;
  while (!text.empty()) {
    const size_t length = CharacterLength(text);
    if (length > 0) {
      valid += text.substr(0, length);
    } else {
      const unsigned char byte = Byte(text, 0);
      valid += {'\\', 'x', kDigits[byte >> 4], kDigits[byte & 15]};
    }
    text.remove_prefix(length > 0 ? length : 1);
  }
  return valid;
}

}  // namespace lazyloc

#include "colmap_lazyloc/results/valid_utf8.h"

#include <boost/locale/utf.hpp>

#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {

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

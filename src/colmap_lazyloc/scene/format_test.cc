#include "colmap_lazyloc/scene/format.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(Format, WritesValuesOfAnyLength) {
  EXPECT_EQ(Format("%.1f px", 2.25), "2.2 px");
  EXPECT_EQ(Format("%s", std::string(5000, 'x').c_str()), std::string(5000, 'x'));
  EXPECT_EQ(Format("none"), "none");
}

TEST(AsOneLine, EscapesControlCharactersAndShortensEndlessWords) {
  EXPECT_EQ(AsOneLine("a name\nof a\x01 file"), "a name\\nof a\\x01 file");
  const std::string name(900, 'n'), value(100'000, '9');
  EXPECT_EQ(AsOneLine(name + ": '" + value + "x' is no number"),
            name + ": '" + value.substr(0, 49) + "...99999999x' is no number");
}

TEST(ValidUtf8, KeepsUtf8) {
  for (const std::string text : {"", "query/00.jpg", "Fu\xC3\x9Fg\xC3\xA4nger", "\xE6\x97\xA5\xED\x9F\xBF",
                                 "\xF0\x9F\x93\xB7", "\xF4\x8F\xBF\xBF", "back\\slash"}) {
    EXPECT_EQ(ValidUtf8(text), text);
  }
  EXPECT_EQ(ValidUtf8(std::string(1, '\0')), std::string(1, '\0'));
}

TEST(ValidUtf8, EscapesOtherBytesAsPythonDoes) {
  EXPECT_EQ(ValidUtf8("caf\xE9.jpg"), "caf\\xe9.jpg");
  EXPECT_EQ(ValidUtf8("\xE4\xB8"), "\\xe4\\xb8");                    // cut off
  EXPECT_EQ(ValidUtf8("\xE4\xB8\x61"), "\\xe4\\xb8\x61");            // continues with a letter
  EXPECT_EQ(ValidUtf8("\xC0\xAF"), "\\xc0\\xaf");                    // too long for a slash
  EXPECT_EQ(ValidUtf8("\xED\xA0\x80"), "\\xed\\xa0\\x80");           // a surrogate
  EXPECT_EQ(ValidUtf8("\xF4\x90\x80\x80"), "\\xf4\\x90\\x80\\x80");  // beyond Unicode
  EXPECT_EQ(ValidUtf8("\xE0\x80\x80"), "\\xe0\\x80\\x80");
  EXPECT_EQ(ValidUtf8("\x80\xFF"), "\\x80\\xff");
}

}  // namespace
}  // namespace lazyloc

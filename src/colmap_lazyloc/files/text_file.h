#pragma once

#include <charconv>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <type_traits>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// Takes the next word (what stands between blanks) off the front of `rest`; empty at the end of the line.
std::string_view NextWord(std::string_view* rest);
std::string_view Trimmed(std::string_view text);

// A text file read line by line, whose errors say `file:line: what is wrong`.
class TextFile {
 public:
  // Throws InputError naming the file where it cannot be opened. Pipes are welcome, folders are not.
  explicit TextFile(const std::filesystem::path& path);

  // The next line without surrounding blanks (a CR of CRLF is one); false at the end of the file.
  bool NextLine();
  // The next line that is neither empty nor a comment (first character '#').
  bool NextEntry();
  // Valid until the next line is read.
  std::string_view Line() const { return line_; }

  // To be thrown: about the current line.
  InputError Error(const std::string& problem) const;

  // Reads the whole word as a number, whatever the locale.
  template <typename T>
  T ParseNumber(std::string_view word) const;

 private:
  std::filesystem::path path_;
  std::ifstream file_;
  std::string buffer_;
  std::string_view line_;
  int64_t line_number_ = 0;
};

template <typename T>
T TextFile::ParseNumber(std::string_view word) const {
  if (word.empty()) throw Error("the line ends too early");
  T number{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  if (error != std::errc() || end != word.data() + word.size()) {
    throw Error("'" + std::string(word) +
                (std::is_integral_v<T> ? "' is not a valid whole number" : "' is not a number"));
  }
  return number;
}

}  // namespace lazyloc

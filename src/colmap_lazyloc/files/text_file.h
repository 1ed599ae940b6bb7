#pragma once

#include <charconv>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// Removes the next word from the front of `rest` and returns it; empty at the end of the line. Words are separated by
// blanks.
std::string_view NextWord(std::string_view* rest);
std::string_view Trimmed(std::string_view text);

// Returns the whole word as a number, whatever the locale; nullopt if it is not one.
template <typename T>
std::optional<T> NumberFrom(std::string_view word) {
  T number{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  return error == std::errc() && end == word.data() + word.size() ? std::make_optional(number) : std::nullopt;
}

// Reads a text file line by line; its errors say `file:line: what is wrong`.
class TextFile {
 public:
  // Throws InputError naming the file if it cannot be opened or is a folder. Pipes can be read.
  explicit TextFile(const std::filesystem::path& path);

  // Goes to the next line, without surrounding blanks (a CR is one). Returns false at the end of the file.
  bool NextLine();
  // Goes to the next line that is neither empty nor a comment (first character '#').
  bool NextEntry();
  // Returns the current line; valid until the next one is read.
  std::string_view Line() const { return line_; }
  // Return where the current line is in the file, with its blanks.
  uint64_t LineOffset() const { return line_offset_; }
  uint64_t LineSize() const { return buffer_.size(); }

  // Returns an error about the current line, to be thrown.
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
  uint64_t line_offset_ = 0, next_offset_ = 0;
};

template <typename T>
T TextFile::ParseNumber(std::string_view word) const {
  if (word.empty()) throw Error("the line ends too early");
  const std::optional<T> number = NumberFrom<T>(word);
  if (!number) {
    throw Error("'" + std::string(word) +
                (std::is_integral_v<T> ? "' is not a valid whole number" : "' is not a number"));
  }
  return *number;
}

}  // namespace lazyloc

#include "colmap_lazyloc/files/text_file.h"

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>

namespace lazyloc {
namespace {

// Replaces std::isspace, because that depends on the locale and names may hold bytes above 127.
constexpr std::string_view kBlanks = " \t\r\v\f";
constexpr std::string_view kUtf8ByteOrderMark = "\xEF\xBB\xBF";

}  // namespace

std::string_view NextWord(std::string_view* rest) {
  rest->remove_prefix(std::min(rest->find_first_not_of(kBlanks), rest->size()));
  const std::string_view word = rest->substr(0, rest->find_first_of(kBlanks));
  rest->remove_prefix(word.size());
  return word;
}

std::string_view Trimmed(std::string_view text) {
  text.remove_prefix(std::min(text.find_first_not_of(kBlanks), text.size()));
  return text.substr(0, text.find_last_not_of(kBlanks) + 1);
}

TextFile::TextFile(const std::filesystem::path& path) : path_(path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) throw InputError(path.string() + ": is a folder, not a file");
  errno = 0;
  file_.open(path);
  if (!file_) throw InputError(path.string() + ": cannot be opened: " + std::generic_category().message(errno));
}

bool TextFile::NextLine() {
  if (!std::getline(file_, buffer_)) {
    if (file_.bad()) throw InputError(path_.string() + ": cannot be read");
    return false;
  }
  line_ = buffer_;
  line_offset_ = std::exchange(next_offset_, next_offset_ + buffer_.size() + 1);
  if (++line_number_ == 1 && line_.substr(0, kUtf8ByteOrderMark.size()) == kUtf8ByteOrderMark) {
    line_.remove_prefix(kUtf8ByteOrderMark.size());
  }
  line_ = Trimmed(line_);
  return true;
}

bool TextFile::NextEntry() {
  while (NextLine()) {
    if (!line_.empty() && line_.front() != '#') return true;
  }
  return false;
}

InputError TextFile::Error(const std::string& problem) const {
  return InputError(path_.string() + ":" + std::to_string(line_number_) + ": " + problem);
}

}  // namespace lazyloc

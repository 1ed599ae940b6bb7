#include "colmap_lazyloc/files/binary_file.h"

#include <cerrno>
#include <system_error>

namespace lazyloc {

BinaryFile::BinaryFile(const std::filesystem::path& path) : path_(path) {
  std::error_code error;
  num_bytes_ = num_bytes_left_ = std::filesystem::file_size(path, error);  // fails for a folder
  if (error) throw Error("cannot be opened: " + error.message());
  errno = 0;
  file_.open(path, std::ios::binary);
  if (!file_) throw Error("cannot be opened: " + std::generic_category().message(errno));
}

void BinaryFile::ReadBytes(unsigned char* bytes, uint64_t num_bytes) {
  if (num_bytes > num_bytes_left_) Truncated();
  file_.read(reinterpret_cast<char*>(bytes), static_cast<std::streamsize>(num_bytes));
  if (!file_) throw Error("cannot be read");
  num_bytes_left_ -= num_bytes;
}

std::string BinaryFile::ReadName() {
  std::string name;
  std::getline(file_, name, '\0');
  if (file_.eof() || name.size() >= num_bytes_left_) Truncated();
  num_bytes_left_ -= name.size() + 1;
  return name;
}

uint64_t BinaryFile::ReadCount() {
  const uint64_t count = Read<uint64_t>();
  if (count > num_bytes_left_) {
    throw Error("announces " + std::to_string(count) +
                " entries, but is too short for them: truncated, or not of COLMAP's binary format");
  }
  return count;
}

void BinaryFile::Skip(uint64_t num_bytes) {
  if (num_bytes > num_bytes_left_) Truncated();
  constexpr uint64_t kMaxNumRead = 4096;  // a seek empties the stream's buffer
  if (num_bytes <= kMaxNumRead) {
    file_.ignore(static_cast<std::streamsize>(num_bytes));
  } else {
    file_.seekg(static_cast<std::streamoff>(num_bytes), std::ios::cur);
  }
  num_bytes_left_ -= num_bytes;
}

void BinaryFile::Truncated() const { throw Error("ends too early: truncated, or not of COLMAP's binary format"); }

void BinaryFile::CheckEnd() const {
  if (num_bytes_left_ > 0) {
    throw Error("has " + std::to_string(num_bytes_left_) +
                " more bytes after its last entry: damaged, or not of COLMAP's binary format");
  }
}

InputError BinaryFile::Error(const std::string& problem) const { return InputError(path_.string() + ": " + problem); }

}  // namespace lazyloc

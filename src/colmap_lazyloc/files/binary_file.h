#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include <boost/endian/conversion.hpp>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// Reads a little-endian binary file from front to back. It checks every size against the bytes that are left, because a
// damaged file may claim any. Every function throws InputError naming the file.
class BinaryFile {
 public:
  explicit BinaryFile(const std::filesystem::path& path);

  template <typename T>
  T Read();
  // Reads up to and including the terminating zero byte.
  std::string ReadName();
  // Reads the number of records that follow.
  uint64_t ReadCount();
  void Skip(uint64_t num_bytes);
  void CheckEnd() const;

  // Returns the number of bytes in front of the next one.
  uint64_t Offset() const { return num_bytes_ - num_bytes_left_; }

  // Returns an error about this file, to be thrown.
  InputError Error(const std::string& problem) const;

 private:
  void ReadBytes(unsigned char* bytes, uint64_t num_bytes);
  [[noreturn]] void Truncated() const;

  std::filesystem::path path_;
  std::ifstream file_;
  uint64_t num_bytes_ = 0, num_bytes_left_ = 0;
};

template <typename T>
T BinaryFile::Read() {
  unsigned char bytes[sizeof(T)];
  ReadBytes(bytes, sizeof(T));
  return boost::endian::endian_load<T, sizeof(T), boost::endian::order::little>(bytes);
}

}  // namespace lazyloc

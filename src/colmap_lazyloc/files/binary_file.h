#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include <boost/endian/conversion.hpp>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// A little-endian binary file, read from front to back. It knows how much is left, so that what a foreign or
// damaged file claims is never believed. Every function throws InputError naming the file.
class BinaryFile {
 public:
  explicit BinaryFile(const std::filesystem::path& path);

  template <typename T>
  T Read();
  // Up to the terminating zero byte, which is taken off too.
  std::string ReadName();
  // A number of records that follow, of at least `min_record_bytes` each.
  uint64_t ReadCount(uint64_t min_record_bytes);
  void Skip(uint64_t num_bytes);
  void CheckEnd() const;

  // To be thrown.
  InputError Error(const std::string& problem) const;

 private:
  void ReadBytes(unsigned char* bytes, uint64_t num_bytes);

  std::filesystem::path path_;
  std::ifstream file_;
  uint64_t num_bytes_left_ = 0;
};

template <typename T>
T BinaryFile::Read() {
  unsigned char bytes[sizeof(T)];
  ReadBytes(bytes, sizeof(T));
  return boost::endian::endian_load<T, sizeof(T), boost::endian::order::little>(bytes);
}

}  // namespace lazyloc

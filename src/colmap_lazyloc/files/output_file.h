#pragma once

#include <filesystem>
#include <fstream>
#include <ostream>

#include <boost/endian/conversion.hpp>

namespace lazyloc {

// Writes a new file, as text with 17 significant digits in any locale, or as little-endian binary. Only Close tells
// whether everything was written, for example if the disk is full.
class OutputFile {
 public:
  // Throws InputError naming the file if it cannot be made.
  explicit OutputFile(const std::filesystem::path& path);

  std::ostream& Text() { return stream_; }

  template <typename T>
  void WriteBinary(T value);

  // Throws InputError naming the file if not everything could be written.
  void Close();

 private:
  std::filesystem::path path_;
  std::ofstream stream_;
};

template <typename T>
void OutputFile::WriteBinary(T value) {
  unsigned char bytes[sizeof(T)];
  boost::endian::endian_store<T, sizeof(T), boost::endian::order::little>(bytes, value);
  stream_.write(reinterpret_cast<const char*>(bytes), sizeof(T));
}

}  // namespace lazyloc

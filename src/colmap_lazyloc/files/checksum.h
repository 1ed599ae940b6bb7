#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

#include <zlib.h>

namespace lazyloc {

// Returns the CRC-32 of bytes that follow those with the CRC-32 `before`.
inline uint32_t Crc32(std::string_view bytes, uint32_t before = 0) {
  return static_cast<uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

// Returns the CRC-32 of the first bytes of a file, all by default; of those that can be read.
inline uint32_t Crc32OfFile(const std::filesystem::path& path, uint64_t num_bytes = ~uint64_t{0}) {
  std::ifstream file(path, std::ios::binary);
  std::string piece(1 << 20, '\0');
  uint32_t crc = 0;
  while (file && num_bytes > 0) {
    file.read(piece.data(), static_cast<std::streamsize>(std::min<uint64_t>(piece.size(), num_bytes)));
    const auto num_read = static_cast<size_t>(file.gcount());
    crc = Crc32({piece.data(), num_read}, crc);
    num_bytes -= num_read;
  }
  return crc;
}

// Returns the size and the checksum of a file as text.
inline std::string FileContent(const std::filesystem::path& path) {
  std::error_code ignored;
  char text[64];
  std::snprintf(text, sizeof(text), "%ju bytes %08x", static_cast<uintmax_t>(std::filesystem::file_size(path, ignored)),
                Crc32OfFile(path));
  return text;
}

// Returns the FNV-1a hash. Millions of names have different ones, which 32 bits would not give.
inline uint64_t Hash64(std::string_view bytes) {
  uint64_t hash = 14695981039346656037u;
  for (const char byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 1099511628211u;
  return hash;
}

}  // namespace lazyloc

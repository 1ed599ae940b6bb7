#pragma once

#include <cstdint>
#include <string_view>

#include <zlib.h>

namespace lazyloc {

// Returns the CRC-32 of bytes that follow those with the CRC-32 `before`.
inline uint32_t Crc32(std::string_view bytes, uint32_t before = 0) {
  return static_cast<uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

}  // namespace lazyloc

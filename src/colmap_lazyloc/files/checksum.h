#pragma once

#include <cstdint>
#include <string_view>

#include <boost/crc.hpp>

namespace lazyloc {

// Returns the CRC-32 of some bytes, the one of zlib.
inline uint32_t Crc32(std::string_view bytes) {
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
}

// Adds up the CRC-64 (ECMA-182) of a stream of bytes.
class Crc64 {
 public:
  void Add(std::string_view bytes) { crc_.process_bytes(bytes.data(), bytes.size()); }
  uint64_t Value() const { return crc_.checksum(); }

 private:
  boost::crc_optimal<64, 0x42F0E1EBA9EA3693ULL, 0, 0, false, false> crc_;
};

}  // namespace lazyloc

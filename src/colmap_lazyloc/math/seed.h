#pragma once

#include <cstdint>
#include <string>

namespace lazyloc {

// Returns the FNV-1a hash of both names and the user's seed. Seeds come from names because threads, ids and order may
// change from run to run.
inline uint32_t SeedFromNames(const std::string& name1, const std::string& name2, int seed) {
  uint32_t hash = 2166136261u ^ static_cast<uint32_t>(seed);
  for (const char character : name1 + '\n' + name2) {
    hash = (hash ^ static_cast<unsigned char>(character)) * 16777619u;
  }
  return hash;
}

}  // namespace lazyloc

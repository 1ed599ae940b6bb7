#pragma once

#include <cstdint>
#include <string>

namespace lazyloc {

// A seed that depends on names alone, never on threads, ids or order: FNV-1a over both names and the user's seed.
inline uint32_t SeedFromNames(const std::string& name1, const std::string& name2, int seed) {
  uint32_t hash = 2166136261u ^ static_cast<uint32_t>(seed);
  for (const char character : name1 + '\n' + name2) {
    hash = (hash ^ static_cast<unsigned char>(character)) * 16777619u;
  }
  return hash;
}

}  // namespace lazyloc

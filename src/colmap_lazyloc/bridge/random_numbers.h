#pragma once

#include <cstdint>
#include <mutex>

// Random numbers that are the same in every run, whatever other threads do.
namespace lazyloc {

// Seeds COLMAP's generator of this thread, from which its RANSAC draws.
void SeedRandomNumbers(uint32_t seed);

// Seeds std::rand(), which all threads share, and keeps it from their SeedRandomNumbers, which seeds it, too.
class ExclusiveRand {
 public:
  explicit ExclusiveRand(uint32_t seed);

 private:
  std::lock_guard<std::mutex> lock_;
};

}  // namespace lazyloc

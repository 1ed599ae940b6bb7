#include "colmap_lazyloc/bridge/random_numbers.h"

#include <cstdlib>

#include <colmap/math/random.h>

namespace lazyloc {
namespace {

std::mutex rand_mutex;

}  // namespace

void SeedRandomNumbers(uint32_t seed) {
  const std::lock_guard<std::mutex> lock(rand_mutex);
  colmap::SetPRNGSeed(seed);
}

ExclusiveRand::ExclusiveRand(uint32_t seed) : lock_(rand_mutex) { std::srand(seed); }

}  // namespace lazyloc

#include "colmap_lazyloc/math/descriptor_products.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <numeric>

#include "colmap_lazyloc/math/vectorized.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace lazyloc {
namespace {

constexpr int kOffset = 128;     // between the signed values of VNNI and descriptors
constexpr int kNumTogether = 4;  // values of a descriptor that VNNI multiplies in one step

size_t PaddedSize(Eigen::Index num_rows, int multiple) {
  return static_cast<size_t>((num_rows + multiple - 1) / multiple * multiple);
}

// Adds up 16-bit products in a loop over all rows, because the compiler then loads a column only once.
LAZYLOC_ALWAYS_INLINE inline void MultiplyPlainly(const uint8_t* __restrict rows, const uint8_t* __restrict block,
                                                  int32_t* __restrict products) {
  int16_t wide_rows[kDescriptorRows * kDescriptorDim];
  for (int k = 0; k < kDescriptorRows * kDescriptorDim; ++k) wide_rows[k] = rows[k];
  for (int j = 0; j < kDescriptorBlock; ++j) {
    int32_t sums[kDescriptorRows] = {};
    for (int k = 0; k < kDescriptorDim; ++k) {
      for (int i = 0; i < kDescriptorRows; ++i) {
        sums[i] += wide_rows[i * kDescriptorDim + k] * static_cast<int16_t>(block[j * kDescriptorDim + k]);
      }
    }
    for (int i = 0; i < kDescriptorRows; ++i) products[i * kDescriptorBlock + j] = sums[i];
  }
}

#if defined(__x86_64__)
// Each lane of a register is a column. Starts with what the offset of the columns takes away.
__attribute__((target("avx512f,avx512vnni"))) void MultiplyWithVnni(const uint8_t* rows, const int32_t* row_sums,
                                                                    const uint8_t* block, ProductTile* products) {
  constexpr int kNumVectors = kDescriptorBlock / kNumLanes;
  __m512i sums[kDescriptorRows][kNumVectors];
  for (int i = 0; i < kDescriptorRows; ++i) {
    for (__m512i& sum : sums[i]) sum = _mm512_set1_epi32(kOffset * row_sums[i]);
  }
  for (int k = 0; k < kDescriptorDim; k += kNumTogether) {
    __m512i columns[kNumVectors];
    for (int v = 0; v < kNumVectors; ++v) {
      columns[v] = _mm512_loadu_si512(block + k * kDescriptorBlock + v * static_cast<int>(sizeof(__m512i)));
    }
    for (int i = 0; i < kDescriptorRows; ++i) {
      int32_t values;
      std::memcpy(&values, rows + i * kDescriptorDim + k, sizeof(values));
      const __m512i row = _mm512_set1_epi32(values);
      for (int v = 0; v < kNumVectors; ++v) sums[i][v] = _mm512_dpbusd_epi32(sums[i][v], row, columns[v]);
    }
  }
  static_assert(sizeof(sums) == sizeof(*products));
  std::memcpy(products, sums, sizeof(sums));
}
#endif

}  // namespace

std::vector<ProductInstructions> AvailableProductInstructions() {
  std::vector<ProductInstructions> available = {ProductInstructions::PLAIN};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) available.push_back(ProductInstructions::AVX2);
  if (__builtin_cpu_supports("avx512vnni")) available.push_back(ProductInstructions::AVX512_VNNI);
#endif
  return available;
}

ProductInstructions FastestProductInstructions() {
  static const ProductInstructions fastest = AvailableProductInstructions().back();
  return fastest;
}

DescriptorRows::DescriptorRows(const DescriptorMatrix& descriptors)
    : values_(PaddedSize(descriptors.rows(), kDescriptorRows) * kDescriptorDim),
      sums_(PaddedSize(descriptors.rows(), kDescriptorRows)) {
  std::copy(descriptors.data(), descriptors.data() + descriptors.size(), values_.begin());
  for (int i = 0; i < NumRows(); ++i) {
    sums_[static_cast<size_t>(i)] = std::accumulate(Row(i), Row(i) + kDescriptorDim, 0);
  }
}

DescriptorBlocks::DescriptorBlocks(const DescriptorMatrix& descriptors, ProductInstructions instructions)
    : values_(PaddedSize(descriptors.rows(), kDescriptorBlock) * kDescriptorDim), instructions_(instructions) {
  std::copy(descriptors.data(), descriptors.data() + descriptors.size(), values_.begin());
  if (instructions != ProductInstructions::AVX512_VNNI) return;
  std::array<uint8_t, kBlockSize> block;
  for (size_t begin = 0; begin < values_.size(); begin += kBlockSize) {
    std::copy_n(&values_[begin], kBlockSize, block.begin());
    for (int k = 0; k < kDescriptorDim; ++k) {
      uint8_t* step = &values_[begin + static_cast<size_t>(k / kNumTogether * kNumTogether * kDescriptorBlock)];
      for (int j = 0; j < kDescriptorBlock; ++j) {
        const uint8_t value = block[static_cast<size_t>(j * kDescriptorDim + k)];
        step[j * kNumTogether + k % kNumTogether] = static_cast<uint8_t>(value - kOffset);
      }
    }
  }
}

void DescriptorBlocks::Multiply(const DescriptorRows& rows, int first_row, int block, ProductTile* products) const {
  const uint8_t* row_values = rows.Row(first_row);
  const uint8_t* block_values = &values_[static_cast<size_t>(block) * kBlockSize];
  int32_t sums[kDescriptorRows * kDescriptorBlock];
  const auto multiply = [&]() LAZYLOC_ALWAYS_INLINE { MultiplyPlainly(row_values, block_values, sums); };
  switch (instructions_) {
#if defined(__x86_64__)
    case ProductInstructions::AVX512_VNNI:
      MultiplyWithVnni(row_values, rows.Sum(first_row), block_values, products);
      return;
    case ProductInstructions::AVX2: RunWithAvx2(multiply); break;
#endif
    default: multiply();
  }
  std::memcpy(products, sums, sizeof(sums));
}

}  // namespace lazyloc

#include "colmap_lazyloc/math/descriptor_products.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <numeric>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__) && defined(__linux__)
#include <sys/auxv.h>

#include <arm_neon.h>
#define LAZYLOC_DOT_PRODUCT
#endif

namespace lazyloc {
namespace {

// What is subtracted from the right factors for VNNI, because its second factor is signed.
constexpr int kOffset = 128;

// Returns the number of values of a descriptor that are multiplied in one step.
constexpr int NumTogether(ProductInstructions instructions) {
  switch (instructions) {
    case ProductInstructions::AVX512_VNNI:
    case ProductInstructions::AVX_VNNI:
    case ProductInstructions::DOT_PRODUCT: return 4;
    case ProductInstructions::AVX2: return 2;
    default: return kDescriptorLength;
  }
}

size_t PaddedSize(Eigen::Index num_rows, int multiple) {
  return static_cast<size_t>((num_rows + multiple - 1) / multiple * multiple);
}

// Adds up 16-bit products in a loop over all rows, because the compiler then loads a column only once.
void MultiplyPlainly(const uint8_t* __restrict rows, const uint8_t* __restrict block, ProductTile* products) {
  int16_t wide_rows[kDescriptorRows * kDescriptorLength];
  for (int k = 0; k < kDescriptorRows * kDescriptorLength; ++k) wide_rows[k] = rows[k];
  for (int j = 0; j < kDescriptorBlock; ++j) {
    int32_t sums[kDescriptorRows] = {};
    for (int k = 0; k < kDescriptorLength; ++k) {
      for (int i = 0; i < kDescriptorRows; ++i) {
        sums[i] += wide_rows[i * kDescriptorLength + k] * static_cast<int16_t>(block[j * kDescriptorLength + k]);
      }
    }
    for (int i = 0; i < kDescriptorRows; ++i) products->rows[i][j / kNumLanes].values[j % kNumLanes] = sums[i];
  }
}

#if defined(__x86_64__)
// Each lane of a register is a column. Computes two registers of columns at once, because more sums do not fit into the
// 16 registers.
__attribute__((target("avx2"))) void MultiplyWithAvx2(const uint8_t* rows, const uint8_t* block,
                                                      ProductTile* products) {
  constexpr int kTogether = NumTogether(ProductInstructions::AVX2);
  int16_t wide_rows[kDescriptorRows * kDescriptorLength];
  for (int k = 0; k < kDescriptorRows * kDescriptorLength; ++k) wide_rows[k] = rows[k];
  for (int j = 0; j < kDescriptorBlock; j += kNumLanes) {
    __m256i sums[kDescriptorRows][2] = {};
#pragma GCC unroll 4  // because the sums are else copied from register to register in each step
    for (int k = 0; k < kDescriptorLength; k += kTogether) {
      const auto* values = reinterpret_cast<const __m128i*>(block + k * kDescriptorBlock + j * kTogether);
      const __m256i columns[2] = {_mm256_cvtepu8_epi16(_mm_loadu_si128(values)),
                                  _mm256_cvtepu8_epi16(_mm_loadu_si128(values + 1))};
      for (int i = 0; i < kDescriptorRows; ++i) {
        int32_t pair;
        std::memcpy(&pair, wide_rows + i * kDescriptorLength + k, sizeof(pair));
        const __m256i row = _mm256_set1_epi32(pair);
        for (int v = 0; v < 2; ++v) sums[i][v] = _mm256_add_epi32(sums[i][v], _mm256_madd_epi16(row, columns[v]));
      }
    }
    static_assert(sizeof(sums[0]) == sizeof(Lanes));
    for (int i = 0; i < kDescriptorRows; ++i) std::memcpy(&products->rows[i][j / kNumLanes], sums[i], sizeof(Lanes));
  }
}

// Starts with what the offset of the columns takes away.
__attribute__((target("avxvnni"))) void MultiplyWithVnni(const uint8_t* rows, const int32_t* row_sums,
                                                         const uint8_t* block, ProductTile* products) {
  constexpr int kTogether = NumTogether(ProductInstructions::AVX_VNNI);
  for (int j = 0; j < kDescriptorBlock; j += kNumLanes) {
    __m256i sums[kDescriptorRows][2];
    for (int i = 0; i < kDescriptorRows; ++i) sums[i][0] = sums[i][1] = _mm256_set1_epi32(kOffset * row_sums[i]);
    for (int k = 0; k < kDescriptorLength; k += kTogether) {
      const auto* values = reinterpret_cast<const __m256i*>(block + k * kDescriptorBlock + j * kTogether);
      const __m256i columns[2] = {_mm256_loadu_si256(values), _mm256_loadu_si256(values + 1)};
      for (int i = 0; i < kDescriptorRows; ++i) {
        int32_t values_of_row;
        std::memcpy(&values_of_row, rows + i * kDescriptorLength + k, sizeof(values_of_row));
        const __m256i row = _mm256_set1_epi32(values_of_row);
        for (int v = 0; v < 2; ++v) sums[i][v] = _mm256_dpbusd_avx_epi32(sums[i][v], row, columns[v]);
      }
    }
    for (int i = 0; i < kDescriptorRows; ++i) std::memcpy(&products->rows[i][j / kNumLanes], sums[i], sizeof(Lanes));
  }
}

__attribute__((target("avx512f,avx512vnni"))) void MultiplyWithAvx512(const uint8_t* rows, const int32_t* row_sums,
                                                                      const uint8_t* block, ProductTile* products) {
  constexpr int kTogether = NumTogether(ProductInstructions::AVX512_VNNI);
  constexpr int kNumVectors = kDescriptorBlock / kNumLanes;
  __m512i sums[kDescriptorRows][kNumVectors];
  for (int i = 0; i < kDescriptorRows; ++i) {
    for (__m512i& sum : sums[i]) sum = _mm512_set1_epi32(kOffset * row_sums[i]);
  }
  for (int k = 0; k < kDescriptorLength; k += kTogether) {
    __m512i columns[kNumVectors];
    for (int v = 0; v < kNumVectors; ++v) {
      columns[v] = _mm512_loadu_si512(block + k * kDescriptorBlock + v * static_cast<int>(sizeof(__m512i)));
    }
    for (int i = 0; i < kDescriptorRows; ++i) {
      int32_t values;
      std::memcpy(&values, rows + i * kDescriptorLength + k, sizeof(values));
      const __m512i row = _mm512_set1_epi32(values);
      for (int v = 0; v < kNumVectors; ++v) sums[i][v] = _mm512_dpbusd_epi32(sums[i][v], row, columns[v]);
    }
  }
  static_assert(sizeof(sums) == sizeof(*products));
  std::memcpy(products, sums, sizeof(sums));
}
#elif defined(LAZYLOC_DOT_PRODUCT)
// Computes four registers of four columns at once, which together with their factors fit into the 32 registers.
__attribute__((target("arch=armv8.2-a+dotprod"))) void MultiplyWithDotProduct(const uint8_t* rows, const uint8_t* block,
                                                                              ProductTile* products) {
  constexpr int kTogether = NumTogether(ProductInstructions::DOT_PRODUCT);
  for (int j = 0; j < kDescriptorBlock; j += kNumLanes) {
    uint32x4_t sums[kDescriptorRows][4] = {};
    for (int k = 0; k < kDescriptorLength; k += kTogether) {
      const uint8x16x4_t columns = vld1q_u8_x4(block + k * kDescriptorBlock + j * kTogether);
      for (int i = 0; i < kDescriptorRows; ++i) {
        uint32_t values;
        std::memcpy(&values, rows + i * kDescriptorLength + k, sizeof(values));
        const uint8x16_t row = vreinterpretq_u8_u32(vdupq_n_u32(values));
        for (int v = 0; v < 4; ++v) sums[i][v] = vdotq_u32(sums[i][v], row, columns.val[v]);
      }
    }
    // Stores registers, because GCC would keep sums in memory that are copied from there.
    for (int i = 0; i < kDescriptorRows; ++i) {
      int32_t* values = products->rows[i][j / kNumLanes].values;
      for (int v = 0; v < 4; ++v) vst1q_s32(values + 4 * v, vreinterpretq_s32_u32(sums[i][v]));
    }
  }
}
#endif

}  // namespace

std::vector<ProductInstructions> AvailableProductInstructions() {
  std::vector<ProductInstructions> available = {ProductInstructions::PLAIN};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) available.push_back(ProductInstructions::AVX2);
  if (__builtin_cpu_supports("avxvnni")) available.push_back(ProductInstructions::AVX_VNNI);
  if (__builtin_cpu_supports("avx512vnni")) available.push_back(ProductInstructions::AVX512_VNNI);
#elif defined(LAZYLOC_DOT_PRODUCT)
  if (getauxval(AT_HWCAP) & HWCAP_ASIMDDP) available.push_back(ProductInstructions::DOT_PRODUCT);
#endif
  return available;
}

ProductInstructions FastestProductInstructions() {
  static const ProductInstructions fastest = AvailableProductInstructions().back();
  return fastest;
}

DescriptorRows::DescriptorRows(const Descriptors& descriptors)
    : values_(PaddedSize(descriptors.rows(), kDescriptorRows) * kDescriptorLength),
      sums_(PaddedSize(descriptors.rows(), kDescriptorRows)) {
  std::copy(descriptors.data(), descriptors.data() + descriptors.size(), values_.begin());
  for (int i = 0; i < NumRows(); ++i) {
    sums_[static_cast<size_t>(i)] = std::accumulate(Row(i), Row(i) + kDescriptorLength, 0);
  }
}

DescriptorBlocks::DescriptorBlocks(const Descriptors& descriptors, ProductInstructions instructions)
    : values_(PaddedSize(descriptors.rows(), kDescriptorBlock) * kDescriptorLength), instructions_(instructions) {
  std::copy(descriptors.data(), descriptors.data() + descriptors.size(), values_.begin());
  const int num_together = NumTogether(instructions);
  const bool is_vnni =
      instructions == ProductInstructions::AVX_VNNI || instructions == ProductInstructions::AVX512_VNNI;
  const int offset = is_vnni ? kOffset : 0;
  std::array<uint8_t, kBlockSize> block;
  for (size_t begin = 0; begin < values_.size(); begin += kBlockSize) {
    std::copy_n(&values_[begin], kBlockSize, block.begin());
    for (int k = 0; k < kDescriptorLength; ++k) {
      uint8_t* step = &values_[begin + static_cast<size_t>(k / num_together * num_together * kDescriptorBlock)];
      for (int j = 0; j < kDescriptorBlock; ++j) {
        const uint8_t value = block[static_cast<size_t>(j * kDescriptorLength + k)];
        step[j * num_together + k % num_together] = static_cast<uint8_t>(value - offset);
      }
    }
  }
}

void DescriptorBlocks::Multiply(const DescriptorRows& rows, int first_row, int block, ProductTile* products) const {
  const uint8_t* row_values = rows.Row(first_row);
  const uint8_t* block_values = &values_[static_cast<size_t>(block) * kBlockSize];
  switch (instructions_) {
#if defined(__x86_64__)
    case ProductInstructions::AVX512_VNNI:
      return MultiplyWithAvx512(row_values, rows.Sum(first_row), block_values, products);
    case ProductInstructions::AVX_VNNI:
      return MultiplyWithVnni(row_values, rows.Sum(first_row), block_values, products);
    case ProductInstructions::AVX2: return MultiplyWithAvx2(row_values, block_values, products);
#elif defined(LAZYLOC_DOT_PRODUCT)
    case ProductInstructions::DOT_PRODUCT: return MultiplyWithDotProduct(row_values, block_values, products);
#endif
    default: MultiplyPlainly(row_values, block_values, products);
  }
}

}  // namespace lazyloc

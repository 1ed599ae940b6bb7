#include "colmap_lazyloc/bridge/sift_detection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "colmap_lazyloc/math/smoothing.h"
#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr int kBandSize = 128;         // rows in which a thread detects keypoints at a time
constexpr int kMaxNumRefinements = 5;  // the position moves by at most one pixel between two
constexpr int kBlock = 64;             // pixels that are compared together

struct Thresholds {
  double peak, edge;
  float first_peak;  // of the value at a pixel

  Thresholds(double peak_threshold, double edge_threshold)
      : peak(peak_threshold), edge(edge_threshold), first_peak(static_cast<float>(0.8 * peak_threshold)) {
    if (first_peak < 0.8 * peak_threshold) {
      first_peak = std::nextafter(first_peak, std::numeric_limits<float>::max());
    }
  }
};

// All levels of some rows of an octave.
class Band {
 public:
  explicit Band(const SiftOctave& octave) : width(octave.width), height(octave.height), octave_(octave) {
    for (int level = 0; level < kNumStoredLevels; ++level) {
      rows_[static_cast<size_t>(level)] = {octave.Level(level).values, 0};
    }
    for (int level = kNumStoredLevels; level < kNumLevels; ++level) {
      weights_.push_back(GaussianWeights(LevelSmoothing(level)));
    }
  }

  // Goes to the rows [begin, end) and those that their keypoints are compared with and refined by.
  void GoTo(int begin, int end);

  const float* Row(int level, int y) const {
    const Rows& rows = rows_[static_cast<size_t>(level)];
    return rows.values + static_cast<size_t>(y - rows.first) * width;
  }
  // Returns the difference of a level and the one after it.
  float Difference(int level, int x, int y) const { return Row(level + 1, y)[x] - Row(level, y)[x]; }

  const int width, height;

 private:
  struct Rows {
    const float* values;
    int first;
  };

  const SiftOctave& octave_;
  std::vector<std::vector<float>> weights_;  // of the levels that are not stored
  std::array<LargeArray, kNumLevels - kNumStoredLevels> buffers_;
  std::array<Rows, kNumLevels> rows_;
};

void Band::GoTo(int begin, int end) {
  const auto radius = [](const std::vector<float>& weights) { return static_cast<int>(weights.size() / 2); };
  int margin = kMaxNumRefinements + radius(weights_[1]);
  SiftLevel source = octave_.Level(kNumStoredLevels - 1);
  int source_first = 0;
  for (size_t i = 0; i < buffers_.size(); ++i) {
    const int first = std::max(begin - margin, 0), last = std::min(end + margin, height);
    if (buffers_[i] == nullptr) {
      buffers_[i] = AllocateLargeArray(static_cast<size_t>(std::min(kBandSize + 2 * margin, height)) * width);
    }
    SmoothRows(source.values, width, source.height, weights_[i], first - source_first, last - source_first,
               buffers_[i].get());
    source = {buffers_[i].get(), width, last - first};
    source_first = first;
    rows_[kNumStoredLevels + i] = {buffers_[i].get(), first};
    margin = kMaxNumRefinements;
  }
}

// The differences at some pixels of a row and in two rows of their neighbours, from one pixel before on.
struct Block {
  using Values = std::array<float, kBlock + 2>;
  Values row, one, other;
};

// The rows of neighbours two at a time, as offsets of level and y. First those that decide for most pixels.
struct RowPair {
  int level_one, y_one, level_other, y_other;
};
constexpr std::array<RowPair, 4> kNeighbours = {RowPair{0, -1, 0, 1}, RowPair{-1, 0, 1, 0}, RowPair{-1, -1, 1, -1},
                                                RowPair{-1, 1, 1, 1}};

LAZYLOC_ALWAYS_INLINE inline void Subtract(const Band& band, int level, int x, int y, int size, Block::Values* values) {
  const float* __restrict one = band.Row(level, y) + x - 1;
  const float* __restrict other = band.Row(level + 1, y) + x - 1;
  for (int i = 0; i < size + 2; ++i) (*values)[i] = other[i] - one[i];
}

LAZYLOC_ALWAYS_INLINE inline bool HasPeak(const Block::Values& values, int size, float threshold) {
  int has_peak = 0;
  for (int i = 1; i <= size; ++i) has_peak |= std::abs(values[i]) >= threshold ? 1 : 0;
  return has_peak != 0;
}

// Keeps what is an extremum among the 8 neighbours in the block. Returns false if nothing is.
LAZYLOC_ALWAYS_INLINE inline bool KeepExtrema(const Block& block, int size, float threshold,
                                              std::array<int, kBlock>* is_extremum) {
  int has_extremum = 0;
  for (int i = 0; i < size; ++i) {
    const auto maximum = [&](const Block::Values& v)
                             LAZYLOC_ALWAYS_INLINE { return std::max(std::max(v[i], v[i + 1]), v[i + 2]); };
    const auto minimum = [&](const Block::Values& v)
                             LAZYLOC_ALWAYS_INLINE { return std::min(std::min(v[i], v[i + 1]), v[i + 2]); };
    const float value = block.row[i + 1];
    const float beside_max = std::max(block.row[i], block.row[i + 2]);
    const float beside_min = std::min(block.row[i], block.row[i + 2]);
    const float max = std::max(std::max(maximum(block.one), maximum(block.other)), beside_max);
    const float min = std::min(std::min(minimum(block.one), minimum(block.other)), beside_min);
    (*is_extremum)[i] &= ((value >= threshold) & (value > max)) | ((value <= -threshold) & (value < min));
    has_extremum |= (*is_extremum)[i];
  }
  return has_extremum != 0;
}

// Finds the extrema among all neighbours of a row from pixel x on. Returns false if there are none.
LAZYLOC_ALWAYS_INLINE inline bool FindExtrema(const Band& band, int level, int x, int y, int size, float threshold,
                                              std::array<int, kBlock>* is_extremum) {
  Block block;
  Subtract(band, level, x, y, size, &block.row);
  if (!HasPeak(block.row, size, threshold)) return false;
  is_extremum->fill(1);
  for (const RowPair& rows : kNeighbours) {
    Subtract(band, level + rows.level_one, x, y + rows.y_one, size, &block.one);
    Subtract(band, level + rows.level_other, x, y + rows.y_other, size, &block.other);
    if (!KeepExtrema(block, size, threshold, is_extremum)) return false;
  }
  return true;
}

// The derivatives of the difference at a pixel, with the finite differences of VLFeat.
struct Derivatives {
  double value;
  double x, y, s;
  double xx, yy, ss, xy, xs, ys;
};

Derivatives Differentiate(const Band& band, int level, int x, int y) {
  const auto at = [&](int dx, int dy, int ds) { return band.Difference(level + ds, x + dx, y + dy); };
  Derivatives d = {};
  d.value = at(0, 0, 0);
  d.x = 0.5 * (at(1, 0, 0) - at(-1, 0, 0));
  d.y = 0.5 * (at(0, 1, 0) - at(0, -1, 0));
  d.s = 0.5 * (at(0, 0, 1) - at(0, 0, -1));
  d.xx = at(1, 0, 0) + at(-1, 0, 0) - 2.0 * d.value;
  d.yy = at(0, 1, 0) + at(0, -1, 0) - 2.0 * d.value;
  d.ss = at(0, 0, 1) + at(0, 0, -1) - 2.0 * d.value;
  d.xy = 0.25 * (at(1, 1, 0) + at(-1, -1, 0) - at(-1, 1, 0) - at(1, -1, 0));
  d.xs = 0.25 * (at(1, 0, 1) + at(-1, 0, -1) - at(-1, 0, 1) - at(1, 0, -1));
  d.ys = 0.25 * (at(0, 1, 1) + at(0, -1, -1) - at(0, -1, 1) - at(0, 1, -1));
  return d;
}

using Offset = std::array<double, 3>;

// Returns where the parabola with these derivatives has its extremum, by Gaussian elimination with the steps of VLFeat;
// 0 if it has none.
Offset FindExtremum(const Derivatives& d) {
  double matrix[3][3] = {{d.xx, d.xy, d.xs}, {d.xy, d.yy, d.ys}, {d.xs, d.ys, d.ss}};
  Offset b = {-d.x, -d.y, -d.s};
  for (int j = 0; j < 3; ++j) {
    int pivot = j;
    for (int i = j + 1; i < 3; ++i) {
      if (std::abs(matrix[i][j]) > std::abs(matrix[pivot][j])) pivot = i;
    }
    const double scale = matrix[pivot][j];
    if (std::abs(scale) < 1e-10f) return {};
    std::swap(matrix[pivot], matrix[j]);
    std::swap(b[pivot], b[j]);
    for (int k = j; k < 3; ++k) matrix[j][k] /= scale;
    b[j] /= scale;
    for (int i = j + 1; i < 3; ++i) {
      const double factor = matrix[i][j];
      for (int k = j; k < 3; ++k) matrix[i][k] -= factor * matrix[j][k];
      b[i] -= factor * b[j];
    }
  }
  for (int i = 2; i > 0; --i) {
    for (int k = i - 1; k >= 0; --k) b[k] -= b[i] * matrix[k][i];
  }
  return b;
}

// Returns a keypoint at an extremum, nullopt if it has too little contrast or is at an edge.
std::optional<SiftKeypoint> Refine(const Band& band, int level, int x, int y, const Thresholds& thresholds) {
  const auto step = [](double offset, int place, int size) {
    return offset > 0.6 && place < size - 2 ? 1 : offset < -0.6 && place > 1 ? -1 : 0;
  };
  Derivatives d = Differentiate(band, level, x, y);
  Offset offset = FindExtremum(d);
  for (int i = 1; i < kMaxNumRefinements; ++i) {
    const int step_x = step(offset[0], x, band.width), step_y = step(offset[1], y, band.height);
    if (step_x == 0 && step_y == 0) break;
    x += step_x;
    y += step_y;
    d = Differentiate(band, level, x, y);
    offset = FindExtremum(d);
  }
  const double value = d.value + 0.5 * (d.x * offset[0] + d.y * offset[1] + d.s * offset[2]);
  const double curvature_ratio = (d.xx + d.yy) * (d.xx + d.yy) / (d.xx * d.yy - d.xy * d.xy);
  const double edge = thresholds.edge;
  const bool is_near = std::abs(offset[0]) < 1.5 && std::abs(offset[1]) < 1.5 && std::abs(offset[2]) < 1.5;
  const double new_x = x + offset[0], new_y = y + offset[1], new_level = level - kFirstKeypointLevel + offset[2];
  const bool is_inside = new_x >= 0 && new_x <= band.width - 1 && new_y >= 0 && new_y <= band.height - 1 &&
                         new_level >= -kFirstKeypointLevel && new_level <= kNumLevels - 1 - kFirstKeypointLevel;
  const bool is_good = std::abs(value) > thresholds.peak && curvature_ratio < (edge + 1) * (edge + 1) / edge &&
                       curvature_ratio >= 0 && is_near && is_inside;
  if (!is_good) return std::nullopt;
  return SiftKeypoint{static_cast<float>(new_x), static_cast<float>(new_y),
                      static_cast<float>(ScaleOfLevel(new_level))};
}

// Appends the keypoints of a row.
LAZYLOC_ALWAYS_INLINE inline void DetectInRow(const Band& band, int level, int y, const Thresholds& thresholds,
                                              std::vector<SiftKeypoint>* keypoints) {
  std::array<int, kBlock> is_extremum;
  for (int x = 1; x < band.width - 1; x += kBlock) {
    const int size = std::min(kBlock, band.width - 1 - x);
    if (!FindExtrema(band, level, x, y, size, thresholds.first_peak, &is_extremum)) continue;
    for (int i = 0; i < size; ++i) {
      if (is_extremum[i] == 0) continue;
      const std::optional<SiftKeypoint> keypoint = Refine(band, level, x + i, y, thresholds);
      if (keypoint) keypoints->push_back(*keypoint);
    }
  }
}

OctaveKeypoints DetectInBand(const Band& band, int begin, int end, const Thresholds& thresholds) {
  OctaveKeypoints keypoints;
  RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
    for (int y = std::max(begin, 1); y < std::min(end, band.height - 1); ++y) {
      for (int i = 0; i < kNumKeypointLevels; ++i) {
        DetectInRow(band, kFirstKeypointLevel + i, y, thresholds, &keypoints[static_cast<size_t>(i)]);
      }
    }
  });
  return keypoints;
}

}  // namespace

OctaveKeypoints DetectKeypoints(const SiftOctave& octave, double peak_threshold, double edge_threshold,
                                IdleThreads* idle_threads) {
  const Thresholds thresholds(peak_threshold, edge_threshold);
  const size_t num_bands = octave.width < 3 ? 0 : static_cast<size_t>((octave.height + kBandSize - 1) / kBandSize);
  std::vector<OctaveKeypoints> of_band(num_bands);
  const auto make_task = [&]() -> IndexedTask {
    return [&, band = std::make_shared<Band>(octave)](size_t i) {
      const int begin = static_cast<int>(i) * kBandSize, end = std::min(begin + kBandSize, octave.height);
      band->GoTo(begin, end);
      of_band[i] = DetectInBand(*band, begin, end, thresholds);
    };
  };
  ParallelForByThread(num_bands, make_task, idle_threads);
  OctaveKeypoints keypoints;
  for (const OctaveKeypoints& band : of_band) {
    for (size_t i = 0; i < keypoints.size(); ++i) {
      keypoints[i].insert(keypoints[i].end(), band[i].begin(), band[i].end());
    }
  }
  return keypoints;
}

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <tuple>
#include <vector>

namespace lazyloc {

// Match between two images: the index of a keypoint of the query and of a keypoint of the other image.
struct Match {
  uint32_t query_point = 0;
  uint32_t other_point = 0;
};

inline bool operator<(const Match& a, const Match& b) {
  return std::tie(a.query_point, a.other_point) < std::tie(b.query_point, b.other_point);
}
inline bool operator==(const Match& a, const Match& b) {
  return a.query_point == b.query_point && a.other_point == b.other_point;
}

using Matches = std::vector<Match>;

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

// How photos are matched, by COLMAP 4's names of features and method. AUTO: the database's features by brute force, and
// photos that this does not localize once more with ALIKED features by LightGlue.
enum class MatcherType { AUTO, SIFT_BRUTEFORCE, ALIKED_BRUTEFORCE, ALIKED_LIGHTGLUE };
template <>
inline constexpr std::array kEnumNames<MatcherType> = {"AUTO", "SIFT_BRUTEFORCE", "ALIKED_BRUTEFORCE",
                                                       "ALIKED_LIGHTGLUE"};

}  // namespace lazyloc

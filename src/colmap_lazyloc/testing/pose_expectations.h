#pragma once

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

inline void ExpectSameBits(const Rigid3d& a, const Rigid3d& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
}

}  // namespace lazyloc

#include "colmap_lazyloc/scene/format.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(Format, WritesValuesOfAnyLength) {
  EXPECT_EQ(Format("%.1f px", 2.25), "2.2 px");
  EXPECT_EQ(Format("%s", std::string(5000, 'x').c_str()), std::string(5000, 'x'));
  EXPECT_EQ(Format("none"), "none");
}

}  // namespace
}  // namespace lazyloc

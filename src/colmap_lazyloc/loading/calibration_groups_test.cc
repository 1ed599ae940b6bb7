#include "colmap_lazyloc/loading/calibration_groups.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

std::vector<std::string> Names(int num) {
  std::vector<std::string> names;
  for (int i = 0; i < num; ++i) names.push_back(Format("query/%03d.jpg", i));
  return names;
}

TEST(ChooseSpread, FewNamesAreAllChosen) {
  EXPECT_THAT(ChooseSpread(Names(3), 20), testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(ChooseSpread({}, 20), testing::IsEmpty());
}

TEST(ChooseSpread, OneOfEachPartIsChosen) {
  const std::vector<size_t> chosen = ChooseSpread(Names(50), 20);
  ASSERT_EQ(chosen.size(), 20u);
  for (size_t i = 0; i < chosen.size(); ++i) {
    EXPECT_GE(chosen[i], 50 * i / 20);
    EXPECT_LT(chosen[i], 50 * (i + 1) / 20);
  }
}

// A second camera took every second to every seventh photo: with even steps, it could have all of those chosen.
TEST(ChooseSpread, PhotosInTurnAreChosenAboutAsOftenAsTheyOccur) {
  for (const int num : {50, 60, 100, 140}) {
    for (int period = 2; period <= 7; ++period) {
      int num_second = 0;
      for (const size_t i : ChooseSpread(Names(num), 20)) num_second += i % period == 0 ? 1 : 0;
      EXPECT_NEAR(num_second, 20.0 / period, 7) << num << " photos, every " << period;
    }
  }
}

}  // namespace
}  // namespace lazyloc

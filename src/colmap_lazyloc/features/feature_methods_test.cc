#include "colmap_lazyloc/features/feature_methods.h"

#include <algorithm>
#include <limits>
#include <vector>

#include <gmock/gmock.h>

#include "colmap_lazyloc/features/feature_statistics.h"
#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;

class FeatureMethodsTest : public IoTest {
 protected:
  FeatureMethods Make(FeatureType database_type) const {
    return MakeFeatureMethods(database_type, {}, {640, 500}, "database.db", options_);
  }
  std::string Error(FeatureType database_type) const {
    return ErrorOf([&] { Make(database_type); });
  }

  FeatureOptions options_;
};

TEST_F(FeatureMethodsTest, SiftNeedsNoModelsAndHasNoFallbackWithoutThem) {
  for (const MatcherType matcher : {MatcherType::AUTO, MatcherType::SIFT_BRUTEFORCE}) {
    options_.matcher = matcher;
    const FeatureMethods methods = Make(FeatureType::SIFT);
    EXPECT_EQ(methods.database->Matcher(), MatcherType::SIFT_BRUTEFORCE);
    EXPECT_EQ(methods.fallback, nullptr);
    EXPECT_FALSE(methods.is_fallback_first);
  }
}

TEST_F(FeatureMethodsTest, ErrorsNameWhatIsMissing) {
  EXPECT_THAT(Error(FeatureType::LOMA_B), HasSubstr("database.db: has features of type LOMA_B, which cannot"));
  EXPECT_THAT(Error(FeatureType::ALIKED_N32), HasSubstr("aliked-n32.onnx by --onnx_path"));
  options_.matcher = MatcherType::SIFT_BRUTEFORCE;
  EXPECT_THAT(Error(FeatureType::ALIKED_N32), HasSubstr("which --FeatureMatching.type SIFT_BRUTEFORCE does not match"));
  options_.matcher = MatcherType::ALIKED_LIGHTGLUE;
  EXPECT_THAT(Error(FeatureType::SIFT), HasSubstr("--onnx_path"));
  options_.matcher = MatcherType::AUTO;
  options_.aliked.onnx_path = folder_;
  EXPECT_THAT(Error(FeatureType::SIFT), HasSubstr("has no file aliked-n16rot.onnx"))
      << "the fallback that was asked for";
}

// Returns a picture of random squares.
PhotoFile MakePhoto(uint32_t seed, int size = 256, int square_size = 16) {
  std::vector<uint8_t> values(static_cast<size_t>(size) * size);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const auto square = static_cast<uint32_t>(y / square_size * size + x / square_size);
      values[static_cast<size_t>(y) * size + x] = static_cast<uint8_t>((square * 2654435761u + seed) >> 20);
    }
  }
  return PhotoFile::FromPixels(values.data(), size, size, 1);
}

TEST_F(FeatureMethodsTest, QueriesAreLocalizedWithTheLargestOfManyFeaturesFirst) {
  const auto smallest = [](const Features& features) {
    float scale = std::numeric_limits<float>::max();
    for (const Keypoint& keypoint : features.keypoints) scale = std::min(scale, KeypointScale(keypoint));
    return scale;
  };
  const PhotoFile photo = MakePhoto(1, 768, 7);
  IdleThreads none(0);
  const FeatureMethods methods = Make(FeatureType::SIFT);
  const Features all = methods.database->Extract(photo, 500, &none);
  const Features first = methods.database->ExtractFirst(photo, 500, &none);
  EXPECT_GT(first.keypoints.size(), 4000u);
  EXPECT_GT(all.keypoints.size(), first.keypoints.size());
  EXPECT_GT(smallest(first), smallest(all));
  options_.sift.max_num_features = 8000;  // another number than the default
  const FeatureMethods chosen = Make(FeatureType::SIFT);
  EXPECT_EQ(chosen.database->ExtractFirst(photo, 500, &none).descriptors,
            chosen.database->Extract(photo, 500, &none).descriptors);
}

// What every method must fulfil; the tests of the program run it for those with models.
TEST_F(FeatureMethodsTest, ResultsAreSortedAndIndependentOfThreads) {
  const FeatureMethods methods = Make(FeatureType::SIFT);
  const FeatureMethod& method = *methods.database;
  IdleThreads none(0), three(3);
  const Features features = method.Extract(MakePhoto(1), 500, &none), again = method.Extract(MakePhoto(1), 500, &three);
  ASSERT_GT(features.keypoints.size(), 50u);
  EXPECT_EQ(features.type, method.Type());
  EXPECT_EQ(features.descriptors, again.descriptors);
  const Camera camera{1, 0, 256, 256, {500, 128, 128}, true};
  const Matches matches = method.Match(features, camera, again, camera);
  EXPECT_GT(matches.size(), 50u);
  EXPECT_TRUE(std::is_sorted(matches.begin(), matches.end()));
  EXPECT_TRUE(method.Match(features, camera, Features{}, camera).empty());
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/database/feature_reader.h"

#include <array>
#include <limits>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/random_descriptors.h"
#include "colmap_lazyloc/testing/test_database.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;
using Schema = TestDatabase::Schema;

class FeatureReaderTest : public ::testing::TestWithParam<Schema> {
 protected:
  static std::vector<Eigen::Vector2d> SomeKeypoints(int count) {
    std::vector<Eigen::Vector2d> keypoints;
    for (int i = 0; i < count; ++i) keypoints.emplace_back(i + 0.25, 2 * i);
    return keypoints;
  }

  TestFolder folder_;
  std::filesystem::path path_ = folder_ / "database.db";
  TestDatabase database_{path_, GetParam()};
};

TEST_P(FeatureReaderTest, ReadsFeaturesAndTheirNumbers) {
  const Descriptors descriptors = RandomDescriptors(5, 1);
  for (const int num_cols : {2, 4, 6}) {
    database_.AddKeypoints(num_cols, SomeKeypoints(5), num_cols);
    database_.AddDescriptors(num_cols, descriptors);
  }
  database_.AddDescriptors(9, Descriptors(0, 0));
  const FeatureReader reader(path_);
  EXPECT_THAT(reader.ReadDescriptorCounts(),
              ::testing::ElementsAre(std::pair(2u, 5u), std::pair(4u, 5u), std::pair(6u, 5u)));
  for (const uint32_t image_id : {2, 4, 6}) {
    const Features features = reader.Read(image_id);
    EXPECT_EQ(features.descriptors, descriptors);
    EXPECT_EQ(Positions(features.keypoints), SomeKeypoints(5));
  }
  for (const uint32_t image_id : {9, 77}) {
    EXPECT_THAT(reader.Read(image_id).keypoints, IsEmpty());
    EXPECT_EQ(reader.Read(image_id).descriptors.rows(), 0);
  }
}

TEST_P(FeatureReaderTest, ReplacesShapesThatAreNotFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  database_.AddScaledKeypoints(1, {{1, 2, 3, nan, 0, 3}, {4, 5, infinity, 0, 0, 3}, {6, 7, 3, -4, 4, 3}});
  database_.AddDescriptors(1, RandomDescriptors(3, 1));
  const std::vector<Keypoint> keypoints = FeatureReader(path_).Read(1).keypoints;
  EXPECT_THAT(Positions(keypoints), ElementsAre(Eigen::Vector2d(1, 2), Eigen::Vector2d(4, 5), Eigen::Vector2d(6, 7)));
  const auto shape = [&](size_t i) {
    return std::array<float, 4>{keypoints[i].a11, keypoints[i].a12, keypoints[i].a21, keypoints[i].a22};
  };
  EXPECT_THAT(shape(0), ElementsAre(1, 0, 0, 1));
  EXPECT_THAT(shape(1), ElementsAre(1, 0, 0, 1));
  EXPECT_THAT(shape(2), ElementsAre(3, -4, 4, 3));
}

TEST_P(FeatureReaderTest, LeavesTheFileAsItIs) {
  database_.AddKeypoints(1, SomeKeypoints(3));
  database_.AddDescriptors(1, RandomDescriptors(3, 1));
  database_.Close();
  const FolderState before = ReadFolderState(folder_.Path());
  FeatureReader(path_).Read(1);
  EXPECT_EQ(ReadFolderState(folder_.Path()), before);
}

TEST_P(FeatureReaderTest, AnotherNumberOfKeypointsIsAnError) {
  database_.AddKeypoints(1, SomeKeypoints(4));
  database_.AddDescriptors(1, RandomDescriptors(3, 1));
  EXPECT_THAT([&] { FeatureReader(path_).Read(1); },
              ThrowsMessage<InputError>(HasSubstr("has 4 keypoints, but 3 descriptors")));
}

TEST_P(FeatureReaderTest, OtherDescriptorsThanSiftAreAnError) {
  database_.AddDescriptors(1, Descriptors::Zero(3, 256));
  const FeatureReader reader(path_);
  std::vector<std::string> damages;
  EXPECT_THAT(reader.ReadDescriptorCounts(&damages), IsEmpty());
  EXPECT_THAT(damages, ElementsAre(HasSubstr("not SIFT's")));
  EXPECT_THAT([&] { reader.Read(1); }, ThrowsMessage<InputError>(HasSubstr("256 columns")));
}

TEST_P(FeatureReaderTest, DamagedDescriptorsAreAnError) {
  database_.AddDescriptors(1, RandomDescriptors(3, 1));
  database_.Execute("UPDATE descriptors SET rows = 4");
  EXPECT_THAT([&] { FeatureReader(path_).Read(1); },
              ThrowsMessage<DamagedRecordError>(HasSubstr("384 bytes for 4 x 128")));
  database_.Execute("UPDATE descriptors SET rows = 2147483647");  // would be 256 GiB
  EXPECT_THAT([&] { FeatureReader(path_).Read(1); },
              ThrowsMessage<DamagedRecordError>(HasSubstr("384 bytes for 2147483647 x 128")));
  database_.Execute("UPDATE descriptors SET rows = -1");
  std::vector<std::string> damages;
  EXPECT_THAT(FeatureReader(path_).ReadDescriptorCounts(&damages), IsEmpty());
  EXPECT_THAT(damages, ElementsAre("table descriptors, image 1: rows is out of range: -1"));
}

INSTANTIATE_TEST_SUITE_P(Schemas, FeatureReaderTest, ::testing::Values(Schema::V3_8, Schema::V4_2));

TEST(FeatureReader, LearnedDescriptorsAreNotSift) {
  const TestFolder folder;
  TestDatabase database(folder / "database.db", Schema::V4_2);
  database.AddDescriptors(1, RandomDescriptors(3, 1), /*type=*/1);
  std::vector<std::string> damages;
  EXPECT_THAT(FeatureReader(folder / "database.db").ReadDescriptorCounts(&damages), IsEmpty());
  EXPECT_THAT(damages, ElementsAre(HasSubstr("type 1")));
}

}  // namespace
}  // namespace lazyloc

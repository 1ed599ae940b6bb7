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
  EXPECT_THAT(reader.ReadDescriptorCounts().of_image,
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

TEST_P(FeatureReaderTest, DescriptorsOfAnotherLengthAreAnError) {
  database_.AddDescriptors(1, Descriptors::Zero(3, 256));
  const FeatureReader reader(path_);
  std::vector<std::string> damages;
  EXPECT_THAT(reader.ReadDescriptorCounts(&damages).of_image, IsEmpty());
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
  EXPECT_THAT(FeatureReader(path_).ReadDescriptorCounts(&damages).of_image, IsEmpty());
  EXPECT_THAT(damages, ElementsAre("table descriptors, image 1: rows is out of range: -1"));
}

INSTANTIATE_TEST_SUITE_P(Schemas, FeatureReaderTest, ::testing::Values(Schema::V3_8, Schema::V4_2));

class FeatureTypes : public ::testing::Test {
 protected:
  void Add(uint32_t image_id, int num_columns, int type) {
    database_.AddKeypoints(image_id, {{1, 2}, {3, 4}, {5, 6}});
    database_.AddDescriptors(image_id, Descriptors::Constant(3, num_columns, 7), type);
  }

  TestFolder folder_;
  std::filesystem::path path_ = folder_ / "database.db";
  TestDatabase database_{path_, Schema::V4_2};
};

TEST_F(FeatureTypes, AreThoseOfTheDatabase) {
  for (const auto& [type, num_columns] :
       {std::pair(0, 128), std::pair(1, 512), std::pair(2, 512), std::pair(3, 1024)}) {
    database_.Execute("DELETE FROM descriptors");
    database_.Execute("DELETE FROM keypoints");
    Add(1, num_columns, type);
    Add(2, num_columns, type);
    const FeatureReader reader(path_);
    EXPECT_EQ(reader.ReadDescriptorCounts().type, static_cast<FeatureType>(type));
    EXPECT_THAT(reader.ReadDescriptorCounts().of_image, ElementsAre(std::pair(1u, 3u), std::pair(2u, 3u)));
    EXPECT_EQ(reader.Read(2).type, static_cast<FeatureType>(type));
    EXPECT_EQ(reader.Read(2).descriptors, Descriptors::Constant(3, num_columns, 7));
  }
}

TEST_F(FeatureTypes, SeveralAreAnError) {
  Add(1, 128, 0);
  Add(2, 512, 1);
  EXPECT_THAT([&] { FeatureReader(path_).ReadDescriptorCounts(); },
              ThrowsMessage<InputError>(HasSubstr("database.db: has features of types SIFT and ALIKED_N16ROT")));
}

TEST_F(FeatureTypes, DamageLeavesTheImageOut) {
  Add(1, 512, 2);
  Add(2, 512, 0);
  Add(3, 128, 2);
  Add(4, 512, 99);
  std::vector<std::string> damages;
  const DescriptorCounts counts = FeatureReader(path_).ReadDescriptorCounts(&damages);
  EXPECT_EQ(counts.type, FeatureType::ALIKED_N32);
  EXPECT_THAT(counts.of_image, ElementsAre(std::pair(1u, 3u)));
  EXPECT_THAT(damages, ElementsAre(HasSubstr("image 2: descriptors are not SIFT's: they have 512 columns"),
                                   HasSubstr("image 3: descriptors are not ALIKED_N32's: they have 128 columns"),
                                   HasSubstr("image 4: type is out of range: 99")));
}

}  // namespace
}  // namespace lazyloc

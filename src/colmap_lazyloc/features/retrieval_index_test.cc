#include "colmap_lazyloc/features/retrieval_index.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/random_descriptors.h"
#include "colmap_lazyloc/testing/test_database.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr int kNumDescriptors = 200;

// Image i has descriptors of its own, which a query of the same number shares but for noise.
class RetrievalIndexTest : public ::testing::Test {
 protected:
  // swaps: image 1 has the descriptors of image 2, and the reverse.
  std::string WriteDatabase(const std::string& name, const std::vector<uint32_t>& image_ids,
                            int num_descriptors = kNumDescriptors, bool swaps = false) {
    const std::filesystem::path path = folder_ / name;
    std::filesystem::remove(path);
    TestDatabase database(path, TestDatabase::Schema::V3_10);
    for (const uint32_t id : image_ids) {
      database.AddImage(id, 1, std::to_string(id) + ".jpg");
      database.AddKeypoints(id, std::vector<Eigen::Vector2d>(num_descriptors, {1, 2}));
      const uint32_t seed = swaps && id <= 2 ? 3 - id : id;
      database.AddDescriptors(id, RandomDescriptors(kNumDescriptors, seed).topRows(num_descriptors));
    }
    database.Close();
    return path.string();
  }

  RetrievalIndex Open(const std::string& database_path, const std::string& index_name = "index") {
    RetrievalOptions options;
    options.num_visual_words = 64;
    const std::filesystem::path path = index_name.empty() ? std::filesystem::path() : folder_ / index_name;
    return {path, DatabaseReader(database_path), options, /*seed=*/0, /*num_threads=*/-1};
  }

  void ExpectFinds(const RetrievalIndex& index, const std::vector<uint32_t>& image_ids) {
    for (const uint32_t id : image_ids) {
      const std::vector<uint32_t> found =
          index.Query({{}, WithNoise(RandomDescriptors(kNumDescriptors, id), 99)}, &idle_threads_);
      ASSERT_FALSE(found.empty());
      EXPECT_EQ(found.front(), id);
    }
  }

  void ExpectRefused(const std::string& database_path, const std::string& message) {
    EXPECT_THAT([&] { Open(database_path); },
                ThrowsMessage<InputError>(AllOf(HasSubstr((folder_ / "index").string()), HasSubstr(message))));
  }

  TestFolder folder_;
  IdleThreads idle_threads_{1};
};

TEST_F(RetrievalIndexTest, FindsImagesAndIsReadAgainAsItWasWritten) {
  const std::string database = WriteDatabase("a.db", {1, 2, 3, 4, 5});
  const RetrievalIndex made = Open(database);
  EXPECT_TRUE(made.LastChanges().is_trained);
  ExpectFinds(made, {1, 2, 3, 4, 5});
  const std::string bytes = ReadBytes(folder_ / "index");
  const RetrievalIndex read = Open(database);
  EXPECT_FALSE(read.LastChanges().is_trained);
  EXPECT_EQ(read.LastChanges().num_added + read.LastChanges().num_removed, 0u);
  EXPECT_EQ(ReadBytes(folder_ / "index"), bytes);
  for (uint32_t id = 1; id <= 5; ++id) {
    const Features query = {{}, WithNoise(RandomDescriptors(kNumDescriptors, id), 7)};
    EXPECT_EQ(read.Query(query, &idle_threads_), made.Query(query, &idle_threads_));
    EXPECT_EQ(read.Query(query, &idle_threads_), Open(database, "").Query(query, &idle_threads_));
  }
}

TEST_F(RetrievalIndexTest, AddedAndRemovedImagesNeedNoTraining) {
  Open(WriteDatabase("a.db", {1, 2, 3, 4, 5}));
  const std::string changed = WriteDatabase("a.db", {2, 3, 4, 5, 6, 7});
  const RetrievalIndex index = Open(changed);
  EXPECT_FALSE(index.LastChanges().is_trained);
  EXPECT_EQ(index.LastChanges().num_added, 2u);
  EXPECT_EQ(index.LastChanges().num_removed, 1u);
  ExpectFinds(index, {2, 3, 4, 5, 6, 7});
  for (const uint32_t id : index.Query({{}, RandomDescriptors(kNumDescriptors, 1)}, &idle_threads_)) EXPECT_NE(id, 1u);
  EXPECT_EQ(Open(changed).LastChanges().num_added, 0u);
}

TEST_F(RetrievalIndexTest, ImagesWithOtherFeaturesAreEnteredAgain) {
  Open(WriteDatabase("a.db", {1, 2, 3}));
  const RetrievalIndex index = Open(WriteDatabase("a.db", {1, 2, 3}, kNumDescriptors - 1));
  EXPECT_EQ(index.NumImages(), 3u);
  ExpectFinds(index, {1, 2, 3});
}

// As if photos had been replaced under the same names.
TEST_F(RetrievalIndexTest, ImagesWithAsManyOtherFeaturesAreEnteredAgain) {
  Open(WriteDatabase("a.db", {1, 2, 3, 4, 5}));
  const RetrievalIndex index = Open(WriteDatabase("a.db", {1, 2, 3, 4, 5}, kNumDescriptors, /*swaps=*/true));
  EXPECT_FALSE(index.LastChanges().is_trained);
  EXPECT_EQ(index.LastChanges().num_removed, 2u);
  EXPECT_EQ(index.LastChanges().num_added, 2u);
  for (const uint32_t id : {1, 2}) {
    EXPECT_EQ(index.Query({{}, RandomDescriptors(kNumDescriptors, 3 - id)}, &idle_threads_).front(), id);
  }
}

TEST_F(RetrievalIndexTest, CopyOfTheDatabaseIsComparedOnce) {
  Open(WriteDatabase("a.db", {1, 2, 3}));
  const std::string bytes = ReadBytes(folder_ / "index");
  std::filesystem::copy(folder_ / "a.db", folder_ / "b.db");
  const RetrievalIndex index = Open(folder_ / "b.db");
  EXPECT_EQ(index.LastChanges().num_added + index.LastChanges().num_removed, 0u);
  const std::string noted = ReadBytes(folder_ / "index");
  EXPECT_NE(noted, bytes);
  Open(folder_ / "b.db");
  EXPECT_EQ(ReadBytes(folder_ / "index"), noted);
}

TEST_F(RetrievalIndexTest, FlippedBitsAreOneError) {
  const std::string database = WriteDatabase("a.db", {1, 2, 3});
  Open(database);
  const std::string bytes = ReadBytes(folder_ / "index");
  for (size_t i = 0; i < bytes.size(); i += i < 300 ? 1 : bytes.size() / 200) {
    std::string flipped = bytes;
    flipped[i] = static_cast<char>(flipped[i] ^ (1 << (i % 8)));
    WriteBytes(folder_ / "index", flipped);
    ExpectRefused(database, "delete it to make it again");
  }
}

TEST_F(RetrievalIndexTest, LargestFeaturesAreIndexedIfThereAreTooMany) {
  // Each image has small features that are the large ones of the image before it.
  constexpr uint32_t kNumImages = 5;
  const auto features_of = [](uint32_t id) { return RandomDescriptors(kNumDescriptors, id % kNumImages); };
  const std::filesystem::path path = folder_ / "a.db";
  TestDatabase database(path, TestDatabase::Schema::V3_10);
  for (uint32_t id = 1; id <= kNumImages; ++id) {
    Descriptors descriptors(2 * kNumDescriptors, kDescriptorLength);
    descriptors << features_of(id + kNumImages - 1), features_of(id);
    std::vector<Keypoint> keypoints(2 * kNumDescriptors);
    for (int i = kNumDescriptors; i < 2 * kNumDescriptors; ++i) keypoints[i].a11 = keypoints[i].a22 = 2;
    database.AddImage(id, 1, std::to_string(id) + ".jpg");
    database.AddScaledKeypoints(id, keypoints);
    database.AddDescriptors(id, descriptors);
  }
  database.Close();
  const DatabaseReader reader(path);
  RetrievalOptions options;
  options.num_visual_words = 64;
  options.max_num_features = kNumDescriptors;
  const RetrievalIndex made(folder_ / "index", reader, options, /*seed=*/0, /*num_threads=*/1);
  // An existing index keeps its number.
  const RetrievalIndex index(folder_ / "index", reader, RetrievalOptions(), /*seed=*/0, /*num_threads=*/1);
  for (uint32_t id = 1; id <= kNumImages; ++id) {
    EXPECT_EQ(index.Query({{}, WithNoise(features_of(id), 99)}, &idle_threads_).front(), id);
  }
  // Small features of a query do not count either.
  Descriptors descriptors(3 * kNumDescriptors, kDescriptorLength);
  descriptors << features_of(1), WithNoise(features_of(2), 98), WithNoise(features_of(2), 99);
  std::vector<Keypoint> keypoints(3 * kNumDescriptors);
  for (int i = 0; i < kNumDescriptors; ++i) keypoints[i].a11 = keypoints[i].a22 = 2;
  EXPECT_EQ(index.Query({keypoints, descriptors}, &idle_threads_).front(), 1u);
  EXPECT_EQ(EstimateIndex(reader, options).num_features, 1000u);
  options.max_num_features = -1;
  EXPECT_EQ(EstimateIndex(reader, options).Text(), "5 images, 2000 features: about 1 MB of memory and of disk");
}

TEST_F(RetrievalIndexTest, BadFilesAreRefusedAndLeftAlone) {
  const std::string database = WriteDatabase("a.db", {1, 2, 3});
  Open(database);
  const std::string bytes = ReadBytes(folder_ / "index");
  ExpectRefused(WriteDatabase("b.db", {11, 12}), "belongs to another");
  EXPECT_EQ(ReadBytes(folder_ / "index"), bytes);
  for (const size_t size : {bytes.size() - 1, bytes.find('\n') + 1}) {
    WriteBytes(folder_ / "index", bytes.substr(0, size));
    ExpectRefused(database, "is truncated or damaged");
  }
  WriteBytes(folder_ / "index", "SQLite format 3");
  ExpectRefused(database, "is not a retrieval index");
  WriteBytes(folder_ / "index", "colmap_lazyloc retrieval index 2 COLMAP-3\n" + std::string(100, '\0'));
  ExpectRefused(database, "another version of the program (delete it to make it again)");
  WriteBytes(folder_ / "index", bytes);
  Open(database);
}

TEST_F(RetrievalIndexTest, DatabaseWithoutDescriptorsIsRefused) {
  const std::string database = WriteDatabase("a.db", {});
  EXPECT_THAT([&] { Open(database); }, ThrowsMessage<InputError>(HasSubstr("a.db: no descriptors")));
}

// Returns unit vectors of single precision, as bytes. noise: of each number.
Descriptors RandomFloats(uint32_t seed, double noise) {
  std::mt19937 directions(seed), errors(seed + 1);
  const auto draw = [](std::mt19937* random) { return static_cast<double>((*random)()) / 2147483648.0 - 1; };
  Descriptors descriptors(kNumDescriptors, kDescriptorLength * sizeof(float));
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    Eigen::RowVectorXd values(kDescriptorLength);
    for (double& value : values) value = draw(&directions);
    values.normalize();
    for (double& value : values) value += noise * draw(&errors);
    const Eigen::RowVectorXf single = values.cast<float>();
    std::memcpy(descriptors.row(i).data(), single.data(), kDescriptorLength * sizeof(float));
  }
  return descriptors;
}

class AlikedIndexTest : public RetrievalIndexTest {
 protected:
  std::string WriteTyped(const std::string& name, int type, const std::vector<uint32_t>& image_ids) {
    TestDatabase database(folder_ / name, TestDatabase::Schema::V4_2);
    for (const uint32_t id : image_ids) {
      database.AddImage(id, 1, std::to_string(id) + ".jpg");
      database.AddKeypoints(id, std::vector<Eigen::Vector2d>(kNumDescriptors, {1, 2}));
      database.AddDescriptors(id, type == 0 ? RandomDescriptors(kNumDescriptors, id) : RandomFloats(id, 0), type);
    }
    database.Close();
    return (folder_ / name).string();
  }
};

TEST_F(AlikedIndexTest, FindsImagesAndIsReadAgain) {
  const std::string database = WriteTyped("a.db", 1, {1, 2, 3, 4, 5});
  for (const bool is_trained : {true, false}) {
    const RetrievalIndex index = Open(database);
    EXPECT_EQ(index.LastChanges().is_trained, is_trained);
    for (uint32_t id = 1; id <= 5; ++id) {
      const Features query = {{}, RandomFloats(id, 0.02), FeatureType::ALIKED_N16ROT};
      EXPECT_EQ(index.Query(query, &idle_threads_).front(), id);
    }
  }
}

TEST_F(AlikedIndexTest, IsForOneTypeOfFeatures) {
  Open(WriteTyped("a.db", 1, {1, 2, 3}));
  ExpectRefused(WriteTyped("b.db", 2, {1, 2, 3}), "of another type of features");
  ExpectRefused(WriteTyped("c.db", 0, {1, 2, 3}), "of another type of features");
  std::filesystem::remove(folder_ / "index");
  Open(folder_ / "c.db");
  ExpectRefused(folder_ / "a.db", "of another type of features");
}

TEST_F(AlikedIndexTest, OtherLearnedFeaturesAreRefused) {
  const std::string database = WriteTyped("a.db", 4, {1});
  EXPECT_THAT([&] { Open(database); }, ThrowsMessage<InputError>(HasSubstr("a.db: has features of type LOMA_B128")));
}

TEST_F(AlikedIndexTest, NumbersThatAreNotFiniteAreHarmless) {
  const std::string database = WriteTyped("a.db", 1, {1, 2, 3, 4, 5});
  const float numbers[] = {std::nanf(""), std::numeric_limits<float>::infinity(), -1e30f};
  Descriptors query = RandomFloats(2, 0);
  for (Eigen::Index i = 0; i < 3; ++i) std::memcpy(query.row(i).data(), &numbers[i], sizeof(float));
  EXPECT_EQ(Open(database).Query({{}, query, FeatureType::ALIKED_N16ROT}, &idle_threads_).front(), 2u);
}

}  // namespace
}  // namespace lazyloc

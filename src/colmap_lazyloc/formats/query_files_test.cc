#include "colmap_lazyloc/formats/query_files.h"

#include <algorithm>

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;
using ::testing::StartsWith;

class QueryList : public IoTest {
 protected:
  static std::vector<QueryListEntry> ReadFile(const std::filesystem::path& path) {
    std::vector<QueryListEntry> entries;
    ReadQueryList(path, [&](const QueryListEntry& entry) {
      const auto is_same = [&](const QueryListEntry& other) { return other.name == entry.name; };
      if (std::any_of(entries.begin(), entries.end(), is_same)) return false;
      entries.push_back(entry);
      return true;
    });
    return entries;
  }
  std::vector<QueryListEntry> Read(const std::string& content) { return ReadFile(WriteFile("list.txt", content)); }
  std::string ErrorOfReading(const std::string& content) {
    return ErrorOf([&] { Read(content); });
  }
};

class Pairs : public IoTest {
 protected:
  using NamePairs = std::vector<std::pair<std::string, std::string>>;
  static NamePairs ReadFile(const std::filesystem::path& path) {
    NamePairs pairs;
    ReadPairs(path, [&](const std::string& name1, const std::string& name2) { pairs.emplace_back(name1, name2); });
    return pairs;
  }
  NamePairs Read(const std::string& content) { return ReadFile(WriteFile("pairs.txt", content)); }
  std::string ErrorOfReading(const std::string& content) {
    return ErrorOf([&] { Read(content); });
  }
};

TEST_F(QueryList, NamesKeepTheirOrderAndBlanks) {
  const auto entries = Read("# queries\n\nnight/b.jpg\n  my holiday photo.jpg \na.jpg");
  ASSERT_EQ(entries.size(), 3);
  EXPECT_EQ(entries[0].name, "night/b.jpg");
  EXPECT_EQ(entries[1].name, "my holiday photo.jpg");
  EXPECT_EQ(entries[2].name, "a.jpg");
  EXPECT_FALSE(entries[1].camera.has_value());
}

TEST_F(QueryList, HlocFormGivesTheCamera) {
  const auto entries = Read("a.jpg SIMPLE_RADIAL 1600 1200 1469.2 800 600 -0.0353019\nb.jpg");
  ASSERT_EQ(entries.size(), 2);
  ASSERT_TRUE(entries[0].camera.has_value());
  EXPECT_EQ(entries[0].name, "a.jpg");
  EXPECT_EQ(entries[0].camera->model_id, 2);
  EXPECT_EQ(entries[0].camera->width, 1600);
  EXPECT_EQ(entries[0].camera->height, 1200);
  EXPECT_THAT(entries[0].camera->params, ElementsAre(1469.2, 800, 600, -0.0353019));
  EXPECT_TRUE(entries[0].camera->has_prior_focal_length);
  EXPECT_FALSE(entries[1].camera.has_value());
}

TEST_F(QueryList, AcceptsCrlfAndByteOrderMark) {
  const auto entries = Read("\xEF\xBB\xBF# exported\r\na.jpg\r\n\r\nb.jpg PINHOLE 4 3 1 1 2 1.5\r\n");
  ASSERT_EQ(entries.size(), 2);
  EXPECT_EQ(entries[0].name, "a.jpg");
  EXPECT_EQ(entries[1].camera->params.back(), 1.5);
}

TEST_F(QueryList, MistakesAreNamedWithTheirLine) {
  EXPECT_THAT(ErrorOfReading("a\n\nb\na\n"), StartsWith("list.txt:4: query 'a' is listed twice"));
  EXPECT_THAT(ErrorOfReading("a PINHOLE 640 480 500 500 320\n"), StartsWith("list.txt:1: "));
  EXPECT_THAT(ErrorOfReading("# c\na PINHOLE 640 480 500 500 320 24O\n"),
              StartsWith("list.txt:2: '24O' is not a number"));
  EXPECT_THAT(ErrorOfReading("a PINHOLE 640 -480 500 500 320 240\n"), HasSubstr("'-480'"));
  EXPECT_THAT(ErrorOfReading("a PINHOLE 640 480 0 500 320 240\n"), HasSubstr("focal length"));
  EXPECT_THAT(ErrorOfReading("a PINHOLE 640 480 nan 500 320 240\n"), HasSubstr("finite"));
  EXPECT_THAT(ErrorOfReading("a PINHOLE\n"), StartsWith("list.txt:1: the line ends too early"));
  EXPECT_THAT(ErrorOfReading("b\na PINHOL 640 480 500 500 320 240\n"),
              StartsWith("list.txt:2: unknown camera model 'PINHOL'"));
  EXPECT_THAT(ErrorOfReading("a pinhole 640 480 500 500 320 240\n"), HasSubstr("'pinhole'"));
}

TEST_F(QueryList, NamesMayEndInNumbers) {
  for (const std::string name : {"scan 2024 01 02 03 04 05", "room at 640 480 500", "a PINHOL 640 480 500 500 b.jpg"}) {
    const auto entries = Read(name);
    ASSERT_EQ(entries.size(), 1);
    EXPECT_EQ(entries[0].name, name);
  }
}

TEST_F(QueryList, EmptyOrMissingFileIsRefused) {
  EXPECT_THAT(ErrorOfReading("# nothing\n\n"), StartsWith("list.txt: contains no query"));
  EXPECT_THAT(ErrorOf([&] { ReadFile(folder_ / "none.txt"); }), StartsWith("none.txt: cannot be opened"));
  std::filesystem::create_directory(folder_ / "sub");
  EXPECT_THAT(ErrorOf([&] { ReadFile(folder_ / "sub"); }), StartsWith("sub: is a folder"));
}

TEST_F(Pairs, AreReadInFileOrder) {
  EXPECT_THAT(Read("# hloc\nq1 z 0.9\na q1\n\nq2 q1 0.1\r\n"),
              ElementsAre(Pair("q1", "z"), Pair("a", "q1"), Pair("q2", "q1")));
}

TEST_F(Pairs, MistakesAreNamed) {
  EXPECT_THAT(ErrorOfReading("q1 a\nq2\n"), StartsWith("pairs.txt:2: expected two image names"));
  EXPECT_THAT(ErrorOfReading("# nothing\n"), StartsWith("pairs.txt: contains no pair"));
  EXPECT_THAT(ErrorOf([&] { ReadFile(folder_ / "none.txt"); }), StartsWith("none.txt: cannot be opened"));
}

}  // namespace
}  // namespace lazyloc

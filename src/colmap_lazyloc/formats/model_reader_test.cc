#include "colmap_lazyloc/formats/model_reader.h"

#include <cstring>
#include <limits>

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr char kCameras[] = "# cameras\n7 PINHOLE 640 480 500.25 501 320 240\n";
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <typename T>
std::string Bytes(T value) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  return bytes;
}

std::string CameraBytes(uint32_t camera_id, int model_id, const std::vector<double>& params) {
  std::string bytes = Bytes(camera_id) + Bytes(model_id) + Bytes<uint64_t>(640) + Bytes<uint64_t>(480);
  for (const double param : params) bytes += Bytes(param);
  return bytes;
}

std::string ImageBytes(uint32_t image_id, const std::vector<double>& pose, const std::string& name, int num_points) {
  std::string bytes = Bytes(image_id);
  for (const double number : pose) bytes += Bytes(number);
  return bytes + Bytes<uint32_t>(7) + name + '\0' + Bytes<uint64_t>(num_points) + std::string(24 * num_points, 'p');
}

class ReadModelTest : public IoTest {
 protected:
  Model ReadText(const std::string& cameras, const std::string& images) {
    WriteFile("cameras.txt", cameras);
    WriteFile("images.txt", images);
    return ReadModel(folder_);
  }
  Model ReadBinary(const std::string& cameras, const std::string& images) {
    WriteFile("cameras.bin", cameras);
    WriteFile("images.bin", images);
    return ReadModel(folder_);
  }
  std::string ErrorOfText(const std::string& cameras, const std::string& images) {
    return ErrorOf([&] { ReadText(cameras, images); });
  }
  std::string ErrorOfBinary(const std::string& cameras, const std::string& images) {
    return ErrorOf([&] { ReadBinary(cameras, images); });
  }

  const std::string cameras_bytes_ = Bytes<uint64_t>(1) + CameraBytes(7, 1, {500.25, 501, 320, 240});
  const std::vector<double> pose_ = {0.1, -0.2, 0.3, 0.9, 1e6 + 0.1, -2, 5e-300};
};

void ExpectPoseBits(const Rigid3d& pose, const std::vector<double>& expected) {
  EXPECT_THAT((std::vector<double>{pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z(),
                                   pose.translation.x(), pose.translation.y(), pose.translation.z()}),
              ::testing::ElementsAreArray(expected));
}

TEST_F(ReadModelTest, AFolderOfModelsIsRefusedWithTheFirstOne) {
  const std::string error = folder_.string() +
                            ": holds no COLMAP model: neither cameras.bin and images.bin nor "
                            "cameras.txt and images.txt";
  WriteFile("log", "");
  EXPECT_EQ(ErrorOf([&] { ReadModel(folder_); }), error);
  for (const std::string name : {"1", "0", "empty"}) std::filesystem::create_directory(folder_ / name);
  for (const std::string name : {"1", "0"}) {
    WriteFile(name + "/cameras.txt", kCameras);
    WriteFile(name + "/images.txt", "");
  }
  EXPECT_EQ(ErrorOf([&] { ReadModel(folder_); }), error + "; give " + (folder_ / "0").string());
}

TEST_F(ReadModelTest, PlacesOfPointsAreThoseOfTheFile) {
  WriteFile("cameras.txt", kCameras);
  const std::string images =
      "\xEF\xBB\xBF# images\n\n3 1 0 0 0 0 0 0 7 b.jpg\n 1 2 -1  \r\n1 1 0 0 0 0 0 0 7 a.jpg\n\n2 1 0 0 0 0 0 0 7 c.jpg";
  const ModelOnDisk text = [&] {
    WriteFile("images.txt", images);
    return ReadModelWithPoints(folder_);
  }();
  EXPECT_EQ(text.images_path, folder_ / "images.txt");
  EXPECT_EQ(images.substr(text.points.at(3).offset, text.points.at(3).num_bytes), " 1 2 -1  \r");
  EXPECT_EQ(text.points.at(1).num_bytes, 0u);
  EXPECT_EQ(text.points.at(2).num_bytes, 0u);
  EXPECT_GT(text.points.at(2).offset, text.points.at(1).offset);
  WriteFile("cameras.bin", cameras_bytes_);
  const std::string bytes = Bytes<uint64_t>(2) + ImageBytes(3, pose_, "b", 5) + ImageBytes(1, pose_, "a", 2);
  WriteFile("images.bin", bytes);
  const ModelOnDisk binary = ReadModelWithPoints(folder_);
  EXPECT_EQ(binary.model.images.front().name, "a");
  for (const auto& [image_id, num_points] : {std::pair(3u, 5u), std::pair(1u, 2u)}) {
    const PointsPlace place = binary.points.at(image_id);
    EXPECT_EQ(bytes.substr(place.offset, place.num_bytes), std::string(24 * num_points, 'p'));
  }
}

TEST_F(ReadModelTest, OnlyQueriesNeedAnImage) {
  EXPECT_THAT(ErrorOfText(kCameras, "# none\n"), StartsWith("images.txt: contains no posed image"));
  EXPECT_TRUE(ReadModelWithPoints(folder_).model.images.empty());
}

TEST_F(ReadModelTest, TextIsReadExactlyAndSortedByName) {
  const Model model = ReadText(kCameras,
                               "# images\n"
                               "3 0.1 -0.2 0.3 0.9 1000000.1 -2 5e-300 7 my photo  1.jpg\n"
                               "\n"
                               "\n"
                               "1 0.99999999999999989 0 0 -0 0.10000000000000001 2 3 7 a/b.jpg\r\n"
                               "10.5 20.5 -1 30 40 12\r\n"
                               "2 1 0 0 0 0 0 0 7 last.jpg");
  ASSERT_EQ(model.images.size(), 3);
  EXPECT_EQ(model.images[0].name, "a/b.jpg");
  EXPECT_EQ(model.images[1].name, "last.jpg");
  EXPECT_EQ(model.images[2].name, "my photo  1.jpg");
  EXPECT_EQ(model.images[2].image_id, 3);
  EXPECT_EQ(model.images[2].camera_id, 7);
  ExpectPoseBits(model.images[0].cam_from_world, {0.99999999999999989, 0, 0, -0.0, 0.1, 2, 3});
  ExpectPoseBits(model.images[2].cam_from_world, pose_);
  ASSERT_EQ(model.cameras.count(7), 1);
  EXPECT_EQ(model.cameras.at(7).camera_id, 7);
  EXPECT_EQ(model.cameras.at(7).model_id, 1);
  EXPECT_THAT(model.cameras.at(7).params, ElementsAre(500.25, 501, 320, 240));
}

TEST_F(ReadModelTest, BinaryIsReadExactlyPointsSkipped) {
  const Model model = ReadBinary(cameras_bytes_, Bytes<uint64_t>(2) + ImageBytes(9, pose_, "z photo.jpg", 1000) +
                                                     ImageBytes(4, {1, 0, 0, 0, 1, 2, 3}, "a.jpg", 0));
  ASSERT_EQ(model.images.size(), 2);
  EXPECT_EQ(model.images[0].name, "a.jpg");
  EXPECT_EQ(model.images[1].name, "z photo.jpg");
  EXPECT_EQ(model.images[1].image_id, 9);
  EXPECT_EQ(model.images[1].camera_id, 7);
  ExpectPoseBits(model.images[1].cam_from_world, pose_);
  EXPECT_THAT(model.cameras.at(7).params, ElementsAre(500.25, 501, 320, 240));
  EXPECT_EQ(model.cameras.at(7).width, 640);
  EXPECT_EQ(model.cameras.at(7).height, 480);
}

TEST_F(ReadModelTest, EveryCameraModelHasItsNumberOfParameters) {
  const std::vector<int> num_params = {3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12};
  std::string bytes = Bytes<uint64_t>(num_params.size());
  for (size_t id = 0; id < num_params.size(); ++id) {
    bytes += CameraBytes(static_cast<uint32_t>(id), static_cast<int>(id), std::vector<double>(num_params[id], 1 + id));
  }
  const Model model = ReadBinary(bytes, Bytes<uint64_t>(1) + ImageBytes(1, pose_, "a.jpg", 0));
  for (size_t id = 0; id < num_params.size(); ++id) {
    EXPECT_EQ(model.cameras.at(id).params, std::vector<double>(num_params[id], 1 + id)) << id;
  }
}

TEST_F(ReadModelTest, BinaryWinsOverText) {
  ReadText(kCameras, "1 1 0 0 0 0 0 0 7 text.jpg\n");
  EXPECT_EQ(ReadBinary(cameras_bytes_, Bytes<uint64_t>(1) + ImageBytes(1, pose_, "binary.jpg", 0)).images[0].name,
            "binary.jpg");
  std::filesystem::remove(folder_ / "cameras.bin");
  EXPECT_EQ(ReadModel(folder_).images[0].name, "text.jpg");
}

TEST_F(ReadModelTest, FolderWithoutModelSaysWhatWasLookedFor) {
  const std::string error = ErrorOf([&] { ReadModel(folder_); });
  for (const char* file : {"cameras.bin", "images.bin", "cameras.txt", "images.txt"}) {
    EXPECT_THAT(error, HasSubstr(file));
  }
  EXPECT_THAT(error, StartsWith(folder_.string()));
}

TEST_F(ReadModelTest, TextMistakesAreNamedWithTheirLine) {
  const std::string image = "1 1 0 0 0 0 0 0 7 a.jpg\n\n";
  EXPECT_EQ(ErrorOfText("1 PANORAMA 4 3 1\n", image), "cameras.txt:1: unknown camera model 'PANORAMA'");
  EXPECT_THAT(ErrorOfText("#\n7 PINHOLE 640 480 500 501 320\n", image), StartsWith("cameras.txt:2: camera 7: "));
  EXPECT_THAT(ErrorOfText("7 PINHOLE 640 480 500 inf 320 240\n", image), StartsWith("cameras.txt:1: camera 7: "));
  EXPECT_THAT(ErrorOfText(std::string(kCameras) + kCameras, image),
              StartsWith("cameras.txt:4: camera 7 appears twice"));
  EXPECT_THAT(ErrorOfText("-1 PINHOLE 640 480 500 501 320 240\n", image), StartsWith("cameras.txt:1: '-1'"));

  EXPECT_THAT(ErrorOfText(kCameras, "# none\n"), StartsWith("images.txt: contains no posed image"));
  EXPECT_THAT(ErrorOfText(kCameras, "1 nan 0 0 0 0 0 0 7 a.jpg\n"),
              StartsWith("images.txt:1: image 1 ('a.jpg'): the pose"));
  EXPECT_THAT(ErrorOfText(kCameras, "1 0 0 0 0 1 2 3 7 a.jpg\n"), HasSubstr("quaternion is zero"));
  EXPECT_THAT(ErrorOfText(kCameras, image + "1 1 0 0 0 0 0 0 7 b.jpg\n"),
              StartsWith("images.txt:3: image 1 ('b.jpg'): its id"));
  EXPECT_THAT(ErrorOfText(kCameras, image + "2 1 0 0 0 0 0 0 7 a.jpg\n"), HasSubstr("its name appears twice"));
  EXPECT_THAT(ErrorOfText(kCameras, "1 1 0 0 0 0 0 0 8 a.jpg\n"), HasSubstr("its camera 8 is missing"));
  EXPECT_THAT(ErrorOfText(kCameras, "1 1 0 0 0 0 0 7 a.jpg\n"), HasSubstr("'a.jpg'"));
  EXPECT_THAT(ErrorOfText(kCameras, "1 1 0 0 0 0 0 0 7\n"), HasSubstr("has no name"));
  EXPECT_THAT(ErrorOfText(kCameras, "1 1,5 0 0 0 0 0 0 7 a.jpg\n"), HasSubstr("'1,5' is not a number"));
}

TEST_F(ReadModelTest, TextWithoutPointLinesIsRefusedNotHalved) {
  EXPECT_THAT(ErrorOfText(kCameras, "1 1 0 0 0 0 0 0 7 a.jpg\n2 1 0 0 0 0 0 0 7 b.jpg\n"),
              StartsWith("images.txt:2: expected the points"));
}

TEST_F(ReadModelTest, TruncatedBinaryIsRefusedAtEveryLength) {
  const std::string images = Bytes<uint64_t>(1) + ImageBytes(1, pose_, "a.jpg", 2);
  for (size_t length = 0; length < images.size(); ++length) {
    EXPECT_THAT(ErrorOfBinary(cameras_bytes_, images.substr(0, length)), StartsWith("images.bin: ")) << length;
  }
  for (size_t length = 0; length < cameras_bytes_.size(); ++length) {
    EXPECT_THAT(ErrorOfBinary(cameras_bytes_.substr(0, length), images), StartsWith("cameras.bin: ")) << length;
  }
}

TEST_F(ReadModelTest, ForeignBinaryIsRefused) {
  const std::string images = Bytes<uint64_t>(1) + ImageBytes(1, pose_, "a.jpg", 0);
  const std::string text =
      "SQLite format 3, and whatever else may stand in a file of another kind that was copied here";
  EXPECT_THAT(ErrorOfBinary(text, images), StartsWith("cameras.bin: announces"));
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, text), StartsWith("images.bin: announces"));
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, images + "x"), StartsWith("images.bin: has 1 more bytes"));
  EXPECT_THAT(ErrorOfBinary(Bytes<uint64_t>(1) + CameraBytes(7, 99, {1, 1, 1}), images),
              StartsWith("cameras.bin: camera 7: unknown camera model 99"));
  // Announces 2^61 points, whose size in bytes would overflow.
  std::string many = images;
  many.replace(many.size() - 8, 8, Bytes(uint64_t{1} << 61));
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, many), StartsWith("images.bin: announces"));
}

TEST_F(ReadModelTest, BinaryMistakesAreNamed) {
  const std::string image = ImageBytes(1, pose_, "a.jpg", 0);
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, Bytes<uint64_t>(0)), StartsWith("images.bin: contains no posed image"));
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, Bytes<uint64_t>(1) + ImageBytes(1, {1, 0, 0, 0, 0, kNaN, 0}, "a.jpg", 0)),
              StartsWith("images.bin: image 1 ('a.jpg'): the pose"));
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, Bytes<uint64_t>(2) + image + image), HasSubstr("its id appears twice"));
  EXPECT_THAT(ErrorOfBinary(cameras_bytes_, Bytes<uint64_t>(1) + ImageBytes(1, pose_, "", 0)),
              HasSubstr("has no name"));
  EXPECT_THAT(ErrorOfBinary(Bytes<uint64_t>(0), Bytes<uint64_t>(1) + image), HasSubstr("its camera 7 is missing"));
}

}  // namespace
}  // namespace lazyloc

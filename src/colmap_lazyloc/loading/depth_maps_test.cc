#include "colmap_lazyloc/loading/depth_maps.h"

#include <cstring>
#include <limits>

#include <gmock/gmock.h>
#include <png.h>

#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::FloatEq;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr double kMillimetre = 0.001;
const Camera kCamera{1, 0, 4, 2, {3, 2, 1}, true};

template <typename Value>
std::string Bytes(const std::vector<Value>& values) {
  std::string bytes(values.size() * sizeof(Value), '\0');
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

// Returns a NumPy file of this type and shape.
std::string Numpy(const std::string& type, const std::string& shape, const std::string& values,
                  const std::string& order = "False") {
  std::string header = "{'descr': '" + type + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }";
  header.resize(117, ' ');
  header += '\n';
  return std::string("\x93NUMPY\x01\x00", 8) + static_cast<char>(header.size()) + '\0' + header + values;
}

std::string ColmapMap(int width, int height, const std::vector<float>& depths) {
  return std::to_string(width) + "&" + std::to_string(height) + "&1&" + Bytes(depths);
}

// Returns a PNG; format: libpng's, PNG_FORMAT_LINEAR_Y has 16 bits.
std::string Png(int width, int height, const void* values, png_uint_32 format = PNG_FORMAT_LINEAR_Y) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = format;
  png_alloc_size_t size = 0;
  EXPECT_TRUE(png_image_write_get_memory_size(image, size, 0, values, 0, nullptr));
  std::string bytes(size, '\0');
  EXPECT_TRUE(png_image_write_to_memory(&image, bytes.data(), &size, 0, values, 0, nullptr));
  bytes.resize(size);
  return bytes;
}

class DepthMapsTest : public IoTest {
 protected:
  std::vector<float> Read(const std::string& name, const std::string& content) const {
    return ReadDepthMap(WriteFile(name, content), kMillimetre).depths;
  }
  std::string ReadError(const std::string& name, const std::string& content) const {
    return ErrorOf([&] { Read(name, content); });
  }
  // Returns the depths at the centres of the upper row's pixels.
  static std::vector<float> DepthsOf(const DepthMaps& maps, const std::string& image_name, uint32_t image_id) {
    return maps.AtKeypoints(image_name, image_id, kCamera, {{0.5, 0.5}, {1.5, 0.5}, {2.5, 0.5}, {3.5, 0.5}});
  }
};

TEST_F(DepthMapsTest, ReadsEveryFormat) {
  const uint16_t values[] = {0, 1, 40000, 65535, 2500, 7};
  EXPECT_THAT(Read("a.png", Png(3, 2, values)),
              ElementsAre(0, FloatEq(0.001F), FloatEq(40), 0, FloatEq(2.5F), FloatEq(0.007F)));
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  const std::vector<float> depths = {1.5, kNan, -2, kInfinity, 0, 3};
  EXPECT_THAT(Read("a.npy", Numpy("<f4", "(2, 3)", Bytes(depths))), ElementsAre(1.5F, 0, 0, 0, 0, 3));
  EXPECT_THAT(Read("a.npy", Numpy("<f8", "(1, 2, 1)", Bytes<double>({1.25, 4}))), ElementsAre(1.25F, 4));
  EXPECT_THAT(Read("a.npy", Numpy("<f2", "(1, 2)", Bytes<uint16_t>({0x3c00, 0x4248}))), ElementsAre(1, 3.140625F));
  const DepthMap map = ReadDepthMap(WriteFile("a.bin", ColmapMap(3, 2, depths)), kMillimetre);
  EXPECT_THAT(map.depths, ElementsAre(1.5F, 0, 0, 0, 0, 3));
  EXPECT_EQ(map.width, 3);
  EXPECT_EQ(map.height, 2);
}

TEST_F(DepthMapsTest, NamesTheFileThatCannotBeUsed) {
  std::vector<uint16_t> values(2000);
  for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<uint16_t>(i * i * 31);
  const std::string png = Png(50, 40, values.data());
  EXPECT_THAT(ReadError("a.png", png.substr(0, png.size() / 2)), StartsWith("a.png: damaged or truncated PNG ("));
  EXPECT_THAT(ReadError("a.png", png.substr(0, 20)), StartsWith("a.png: not a readable PNG ("));
  EXPECT_THAT(ReadError("a.png", "GIF89a"), StartsWith("a.png: not a readable PNG ("));
  const uint8_t grey[] = {1, 2};
  EXPECT_EQ(ReadError("a.png", Png(2, 1, grey, PNG_FORMAT_GRAY)),
            "a.png: not a depth map: it must have one channel of 16 bits");
  EXPECT_EQ(ReadError("a.npy", "text"), "a.npy: not a NumPy file");
  const std::string array =
      "a.npy: not a depth map: it must be an array of rows and columns of float16, float32 or float64";
  EXPECT_EQ(ReadError("a.npy", Numpy("<i4", "(1, 2)", "12345678")), array);
  EXPECT_EQ(ReadError("a.npy", Numpy("<f4", "(2,)", "12345678")), array);
  EXPECT_EQ(ReadError("a.npy", Numpy("<f4", "(1, 2)", "12345678", "True")), array);
  EXPECT_THAT(ReadError("a.npy", Numpy("<f4", "(1, 3)", "12345678")), HasSubstr("ends too early"));
  EXPECT_THAT(ReadError("a.npy", Numpy("<f4", "(1, 1)", "12345678")), HasSubstr("4 more bytes"));
  EXPECT_EQ(ReadError("a.npy", Numpy("<f4", "(999999999, 999999999)", "")), "a.npy: has an impossible size");
  EXPECT_EQ(ReadError("a.bin", "a&b&1&"), "a.bin: not a depth map of COLMAP");
  EXPECT_EQ(ReadError("a.bin", "1&1&3&123456789012"), "a.bin: not a depth map of COLMAP: it has 3 channels");
  EXPECT_THAT(ReadError("a.bin", "9999&9999&1&1234"), HasSubstr("ends too early"));
}

TEST(DepthAt, InterpolatesBetweenPixelsOfAnyResolution) {
  // Makes a plane whose inverse depth is 1 in the left pixel and 0.5 in the right one.
  const DepthMap map{2, 1, {1, 2}};
  const DepthMap wide{2, 2, {1, 1.05F, 1, 1.05F}};
  const Camera camera{1, 0, 8, 8, {}, true};
  EXPECT_FLOAT_EQ(DepthAt(wide, camera, {2, 4}), 1);
  EXPECT_FLOAT_EQ(DepthAt(wide, camera, {4, 4}), 2 / (1 + 1 / 1.05F));
  EXPECT_FLOAT_EQ(DepthAt(wide, camera, {7.9, 7.9}), 1.05F);  // no neighbour: the nearest pixel
  EXPECT_EQ(DepthAt(wide, camera, {9.1, 4}), 0);
  EXPECT_EQ(DepthAt(wide, camera, {4, -3}), 0);
  EXPECT_EQ(DepthAt(map, camera, {2, 4}), 0);  // a jump from 1 to 2
}

TEST(DepthAt, KnowsNoDepthNextToAJump) {
  // Makes two surfaces, columns 0 to 2 and 3 to 5.
  DepthMap map{6, 3, {}};
  for (int i = 0; i < 18; ++i) map.depths.push_back(i % 6 < 3 ? 1.0F : 1.3F);
  const Camera camera{1, 0, 6, 3, {}, true};
  EXPECT_FLOAT_EQ(DepthAt(map, camera, {1.5, 1.5}), 1);
  EXPECT_EQ(DepthAt(map, camera, {2.5, 1.5}), 0);
  EXPECT_EQ(DepthAt(map, camera, {3.5, 1.5}), 0);
  EXPECT_FLOAT_EQ(DepthAt(map, camera, {4.5, 1.5}), 1.3F);
  for (int i = 0; i < 18; ++i) map.depths[i] = 1 + 0.1F * static_cast<float>(i % 6);  // a slanted surface
  EXPECT_FLOAT_EQ(DepthAt(map, camera, {2.5, 1.5}), 1.2F);
}

TEST_F(DepthMapsTest, FindsMapsByTheNamesOfImages) {
  std::filesystem::create_directory(folder_ / "left");
  const auto content = [](float depth) { return ColmapMap(4, 2, std::vector<float>(8, depth)); };
  WriteFile("left/1.jpg.geometric.bin", content(1));
  WriteFile("left/2.bin", content(20));  // not searched: without the image's ending, .bin may be any file
  WriteFile("left/2.npy", Numpy("<f4", "(2, 4)", Bytes(std::vector<float>(8, 2))));
  WriteFile("left/3.jpg.bin", content(3));
  WriteFile("left/3.photometric.bin", content(30));  // the other name comes first
  const std::vector<uint16_t> values(8, 4000);
  WriteFile("frame-4.depth.png", Png(4, 2, values.data()));
  const DepthMaps maps({folder_, kMillimetre});
  EXPECT_THAT(DepthsOf(maps, "left/1.jpg", 1), ElementsAre(1, 1, 1, 1));
  EXPECT_THAT(DepthsOf(maps, "left/2.jpg", 2), ElementsAre(2, 2, 2, 2));
  EXPECT_THAT(DepthsOf(maps, "left/3.jpg", 3), ElementsAre(3, 3, 3, 3));
  EXPECT_THAT(DepthsOf(maps, "frame-4.color.png", 4), ElementsAre(4, 4, 4, 4));
  EXPECT_THAT(maps.Problems(), IsEmpty());
  EXPECT_THAT(maps.MissingMaps(), IsEmpty());
}

TEST_F(DepthMapsTest, WarnsOfMapsThatCannotBeUsed) {
  WriteFile("zero.jpg.bin", ColmapMap(4, 2, std::vector<float>(8, 0)));
  WriteFile("tall.jpg.bin", ColmapMap(2, 4, std::vector<float>(8, 1)));
  const DepthMaps maps({folder_, kMillimetre});
  uint32_t id = 0;
  for (const char* name : {"zero.jpg", "tall.jpg", "none.jpg", "also_none.jpg"}) {
    EXPECT_THAT(DepthsOf(maps, name, ++id), IsEmpty());
    EXPECT_THAT(DepthsOf(maps, name, id), IsEmpty());  // does not warn twice
  }
  const std::string folder = folder_;
  EXPECT_THAT(
      maps.Problems(),
      ElementsAre("no depth for image tall.jpg: " + folder +
                      "/tall.jpg.bin: measures 2 x 4 pixels, which is not the aspect ratio of its image with 4 x 2",
                  "no depth for image zero.jpg: " + folder + "/zero.jpg.bin: has no known depth"));
  EXPECT_EQ(maps.MissingMaps(), "no depth map for 2 database images (for example also_none.jpg) in " + folder);
}

TEST_F(DepthMapsTest, SamplesTheKeypointsThatAreAskedFor) {
  WriteFile("a.jpg.bin", ColmapMap(4, 2, {1, 1.02F, 1.04F, 1.06F, 1, 1.02F, 1.04F, 1.06F}));
  const DepthMaps maps({folder_, kMillimetre});
  EXPECT_THAT(DepthsOf(maps, "a.jpg", 1), ElementsAre(1, FloatEq(1.02F), FloatEq(1.04F), FloatEq(1.06F)));
  EXPECT_THAT(maps.AtKeypoints("a.jpg", 1, kCamera, {{2.5, 0.5}}), ElementsAre(FloatEq(1.04F)));
}

TEST_F(DepthMapsTest, NeedsAFolder) {
  EXPECT_EQ(ErrorOf([&] {
              DepthMaps({folder_ / "missing", kMillimetre});
            }),
            "depth_path " + (folder_ / "missing").string() + " is not a folder");
}

}  // namespace
}  // namespace lazyloc

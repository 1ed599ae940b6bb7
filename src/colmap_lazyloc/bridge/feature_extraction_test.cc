#include "colmap_lazyloc/bridge/feature_extraction.h"

#include <atomic>
#include <fstream>
#include <set>
#include <thread>
#include <tuple>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/scene/quarter_turns.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

constexpr int kWidth = 35, kHeight = 20;

// Returns a directory of EXIF with one entry, a short unless its tag is that of another directory.
std::string ExifDirectory(const std::string& tag, char value) {
  const bool is_pointer = tag == "\x69\x87";
  return std::string("\x01\0", 2) + tag + (is_pointer ? '\x04' : '\x03') + std::string("\0\x01\0\0\0", 5) + value +
         std::string(7, '\0');
}

// Returns the segment of a JPEG file with these directories of EXIF.
std::string ExifSegment(const std::string& directories) {
  const std::string content = std::string("Exif\0\0II*\0\x08\0\0\0", 14) + directories;
  return std::string("\xFF\xE1\0", 3) + static_cast<char>(content.size() + 2) + content;
}

void WriteJpeg(const std::filesystem::path& path, const colmap::Bitmap& bitmap, const std::string& directories) {
  bitmap.Write(path.string());
  std::string jpeg = ReadBytes(path);
  std::ofstream(path, std::ios::binary) << jpeg.insert(2, ExifSegment(directories));
}

void WritePhoto(const std::filesystem::path& path, char focal_length_mm) {
  const std::string main = ExifDirectory("\x69\x87", 26);  // the second directory begins at byte 26
  WriteJpeg(path, AllocateBitmap(kWidth, kHeight, /*as_rgb=*/false), main + ExifDirectory("\x05\xA4", focal_length_mm));
}

TEST(PhotoFile, ThreadsReadExifOfTheirOwnPhoto) {
  const TestFolder folder;
  std::atomic<int> num_wrong = 0;
  std::set<double> values;
  std::vector<std::thread> threads;
  for (const char focal_length_mm : {'\x14', '\x1E', '\x28', '\x32'}) {
    const std::filesystem::path path = folder / (std::to_string(focal_length_mm) + ".jpg");
    WritePhoto(path, focal_length_mm);
    // Asks COLMAP for the pixels, because 3.10 takes the film's width for the image's larger side, and 4 its diagonal.
    const std::optional<double> focal_length_px = PhotoFile::Read(path)->Properties().exif_focal_length_px;
    EXPECT_TRUE(focal_length_px && values.insert(*focal_length_px).second);
    threads.emplace_back([&num_wrong, path, focal_length_px] {
      for (int i = 0; i < 500; ++i) {
        const std::optional<PhotoFile> photo = PhotoFile::Read(path);
        if (!photo || photo->Properties().exif_focal_length_px != focal_length_px) ++num_wrong;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(num_wrong, 0);
}

// A photo of random squares whose left half is brighter.
colmap::Bitmap MakeBitmap() {
  constexpr int kSize = 8;
  colmap::Bitmap bitmap = AllocateBitmap(20 * kSize, 12 * kSize, /*as_rgb=*/false);
  for (int y = 0; y < bitmap.Height(); ++y) {
    for (int x = 0; x < bitmap.Width(); ++x) {
      const auto square = static_cast<uint32_t>(y / kSize * bitmap.Width() + x / kSize);
      const uint32_t value = (square * 2654435761u >> 25) + (x < bitmap.Width() / 2 ? 128 : 0);
      bitmap.SetPixel(x, y, colmap::BitmapColor<uint8_t>(static_cast<uint8_t>(value)));
    }
  }
  return bitmap;
}

double MeanRed(const RgbImage& image, int min_x, int min_y, int max_x, int max_y) {
  double sum = 0;
  for (int y = min_y; y < max_y; ++y) {
    for (int x = min_x; x < max_x; ++x) sum += image.values[static_cast<size_t>(3 * (y * image.width + x))];
  }
  return sum / ((max_x - min_x) * (max_y - min_y));
}

// 6: the left edge of the stored pixels is the upper one, 8: the lower one, 3: the right one.
TEST(PhotoFile, FeaturesOfAPhotoThatExifTurnsAreThoseOfTheUprightPhoto) {
  const TestFolder folder;
  const colmap::Bitmap bitmap = MakeBitmap();
  IdleThreads none(0);
  for (const auto& [orientation, quarter_turns] : {std::pair{'\x06', 3}, {'\x08', 1}, {'\x03', 2}}) {
    const std::filesystem::path path = folder / "photo.jpg";
    WriteJpeg(path, bitmap, ExifDirectory(std::string("\x12\x01", 2), orientation));
    const PhotoFile photo = PhotoFile::Read(path).value();
    ASSERT_EQ(photo.Properties().quarter_turns, quarter_turns);
    EXPECT_EQ(photo.Properties().width, static_cast<uint64_t>(bitmap.Width()));
    const RgbImage upright = photo.ToRgb(1000);
    const int width = upright.width, height = upright.height;
    ASSERT_EQ(width, quarter_turns == 2 ? bitmap.Width() : bitmap.Height());
    const double top = MeanRed(upright, 0, 0, width, height / 2),
                 bottom = MeanRed(upright, 0, height / 2, width, height);
    const double left = MeanRed(upright, 0, 0, width / 2, height),
                 right = MeanRed(upright, width / 2, 0, width, height);
    EXPECT_GT(quarter_turns == 3 ? top - bottom : quarter_turns == 1 ? bottom - top : right - left, 100);

    std::vector<uint8_t> grey;
    for (size_t i = 0; i < upright.values.size(); i += 3) grey.push_back(upright.values[i]);
    SiftExtractionOptions options;
    const Features expected = PhotoFile::FromPixels(grey.data(), width, height, 1).ExtractFeatures(options, &none);
    options.turns_photos = true;
    const Features features = photo.ExtractFeatures(options, &none);
    ASSERT_GT(features.keypoints.size(), 50u);
    EXPECT_EQ(features.descriptors, expected.descriptors);
    for (size_t i = 0; i < features.keypoints.size(); ++i) {
      const Keypoint turned = Turned(features.keypoints[i], quarter_turns, static_cast<float>(bitmap.Width()),
                                     static_cast<float>(bitmap.Height()));
      ASSERT_NEAR(turned.x, expected.keypoints[i].x, 1e-4);
      ASSERT_NEAR(turned.y, expected.keypoints[i].y, 1e-4);
      ASSERT_NEAR(turned.a21, expected.keypoints[i].a21, 1e-4);
    }
    options.turns_photos = false;
    EXPECT_NE(photo.ExtractFeatures(options, &none).descriptors, expected.descriptors);
  }
}

// A binary PNM file, the simplest one with 16 bits.
void WritePnm(const std::filesystem::path& path, int num_bytes) {
  std::ofstream file(path, std::ios::binary);
  file << "P6\n2 1\n" << (num_bytes == 1 ? 255 : 65535) << "\n";
  for (const int value : {200, 100, 50, 0, 30, 250}) {
    for (int i = 0; i < num_bytes; ++i) file.put(static_cast<char>(value));
  }
}

TEST(PhotoFile, SixteenBitsPerColourAreReadLikeEight) {
  const TestFolder folder;
  WritePnm(folder / "8.ppm", 1);
  WritePnm(folder / "16.ppm", 2);
  for (const bool as_rgb : {true, false}) {
    const std::optional<PhotoFile> photo = PhotoFile::Read(folder / "16.ppm", as_rgb);
    ASSERT_TRUE(photo.has_value());
    EXPECT_EQ(photo->ToRgb(10).values, PhotoFile::Read(folder / "8.ppm", as_rgb)->ToRgb(10).values);
  }
}

TEST(PhotoFile, ReducedPhotosHaveAtMostTheSizeThatIsAskedFor) {
  const TestFolder folder;
  for (const char* const name : {"photo.jpg", "photo.png"}) {
    const std::filesystem::path path = folder / name;
    AllocateBitmap(400, 240, /*as_rgb=*/true).Write(path.string());
    for (const auto& [max_size, width, height] : {std::tuple{100, 100, 60}, {150, 150, 90}, {1000, 400, 240}}) {
      const std::optional<PhotoFile> photo = PhotoFile::ReadReduced(path, max_size);
      ASSERT_TRUE(photo.has_value()) << name;
      EXPECT_EQ(photo->Properties().width, static_cast<uint64_t>(width)) << name;
      EXPECT_EQ(photo->Properties().height, static_cast<uint64_t>(height)) << name;
      IdleThreads none(0);
      EXPECT_TRUE(photo->ExtractFeatures({}, &none).keypoints.empty()) << "the photo is black";
    }
  }
  std::ofstream(folder / "text.jpg") << "no photo";
  EXPECT_FALSE(PhotoFile::ReadReduced(folder / "text.jpg", 100).has_value());
  EXPECT_FALSE(PhotoFile::ReadReduced(folder / "missing.jpg", 100).has_value());
}

}  // namespace
}  // namespace lazyloc

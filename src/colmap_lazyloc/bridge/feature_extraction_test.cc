#include "colmap_lazyloc/bridge/feature_extraction.h"

#include <atomic>
#include <fstream>
#include <set>
#include <thread>
#include <tuple>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

constexpr int kWidth = 35, kHeight = 20;

// Returns the segment of a JPEG file that gives EXIF's focal length for a film of 35 mm.
std::string ExifSegment(char focal_length_mm) {
  const std::string main_directory("\x01\0\x69\x87\x04\0\x01\0\0\0\x1A\0\0\0\0\0\0\0", 18);  // EXIF's begins at byte 26
  const std::string exif_directory("\x01\0\x05\xA4\x03\0\x01\0\0\0", 10), end("\0\0\0\0\0\0\0", 7);
  const std::string content =
      std::string("Exif\0\0II*\0\x08\0\0\0", 14) + main_directory + exif_directory + focal_length_mm + end;
  return std::string("\xFF\xE1\0", 3) + static_cast<char>(content.size() + 2) + content;
}

void WritePhoto(const std::filesystem::path& path, char focal_length_mm) {
  AllocateBitmap(kWidth, kHeight, /*as_rgb=*/false).Write(path.string());
  std::string jpeg = ReadBytes(path);
  std::ofstream(path, std::ios::binary) << jpeg.insert(2, ExifSegment(focal_length_mm));
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

#include "colmap_lazyloc/formats/png_reader.h"

#include <csetjmp>
#include <cstdio>
#include <memory>
#include <string>

#include <png.h>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Keeps the message of an error and returns to where the reader was started, because libpng is C.
[[noreturn]] void KeepError(png_structp png, png_const_charp message) {
  *static_cast<std::string*>(png_get_error_ptr(png)) = message;
  std::longjmp(png_jmpbuf(png), 1);
}

// The objects of libpng, which a jump must not skip the destructor of.
struct Reader {
  Reader()
      : png(png_create_read_struct(PNG_LIBPNG_VER_STRING, &error, KeepError, [](png_structp, png_const_charp) {})) {
    if (png != nullptr) info = png_create_info_struct(png);
  }
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  std::string error;
  png_structp png = nullptr;
  png_infop info = nullptr;
};

// Reads the header. Has no objects of its own, because an error of libpng jumps out of it.
bool ReadHeader(std::FILE* file, Reader* reader) {
  if (setjmp(png_jmpbuf(reader->png)) != 0) return false;
  png_init_io(reader->png, file);
  png_read_info(reader->png, reader->info);
  return true;
}

// Reads the pixels in the byte order of the machine, in the same way.
bool ReadPixels(png_bytepp rows, Reader* reader) {
  if (setjmp(png_jmpbuf(reader->png)) != 0) return false;
  const uint16_t one = 1;
  if (*reinterpret_cast<const unsigned char*>(&one) == 1) png_set_swap(reader->png);
  png_set_interlace_handling(reader->png);
  png_read_update_info(reader->png, reader->info);
  png_read_image(reader->png, rows);
  png_read_end(reader->png, nullptr);
  return true;
}

}  // namespace

GreyPng ReadGreyPng(const std::filesystem::path& path) {
  const auto error = [&](const std::string& problem) { return InputError(path.string() + ": " + problem); };
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), std::fclose);
  if (!file) throw error("cannot be opened");
  Reader reader;
  if (reader.info == nullptr) throw error("libpng cannot be used");
  if (!ReadHeader(file.get(), &reader)) throw error("not a readable PNG (" + reader.error + ")");
  GreyPng image;
  image.width = static_cast<int>(png_get_image_width(reader.png, reader.info));
  image.height = static_cast<int>(png_get_image_height(reader.png, reader.info));
  if (png_get_bit_depth(reader.png, reader.info) != 16 ||
      png_get_color_type(reader.png, reader.info) != PNG_COLOR_TYPE_GRAY) {
    throw error("not a depth map: it must have one channel of 16 bits");
  }
  const size_t width = static_cast<size_t>(image.width), height = static_cast<size_t>(image.height);
  if (width > kMaxNumDepthPixels / height) throw error("too large for a depth map");
  image.values.resize(width * height);
  std::vector<png_bytep> rows(height);
  for (size_t y = 0; y < height; ++y) rows[y] = reinterpret_cast<png_bytep>(&image.values[y * width]);
  if (!ReadPixels(rows.data(), &reader)) throw error("damaged or truncated PNG (" + reader.error + ")");
  return image;
}

}  // namespace lazyloc

#include "colmap_lazyloc/database/sqlite_file.h"

#include <array>
#include <cstring>
#include <fstream>
#include <system_error>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

constexpr size_t kHeaderSize = 100;
constexpr uintmax_t kWalHeaderSize = 32;

// Reads a number of SQLite's file format, which is big endian.
uint32_t BigEndian(const unsigned char* bytes, int num_bytes) {
  uint32_t value = 0;
  for (int i = 0; i < num_bytes; ++i) value = value << 8 | bytes[i];
  return value;
}

std::filesystem::path WithSuffix(std::filesystem::path path, const char* suffix) { return path += suffix; }

}  // namespace

SqliteFile::SqliteFile(const std::filesystem::path& path) : path_(path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found) Fail("does not exist");
  if (error) Fail("cannot be read: " + error.message());
  if (std::filesystem::is_directory(status)) Fail("is a folder, not a database");
  if (!std::filesystem::is_regular_file(status)) Fail("is not a regular file");
  // Resolves links, because WAL and journal are beside the file itself.
  real_path_ = std::filesystem::canonical(path, error);
  if (error) Fail("cannot be read: " + error.message());
  wal_path_ = WithSuffix(real_path_, "-wal");
  main_ = ReadState(real_path_);
  wal_ = ReadState(wal_path_);
  CheckNoHotJournal();
  CheckHeader();
}

SqliteFile::State SqliteFile::ReadState(const std::filesystem::path& path) {
  std::error_code size_error, time_error;
  const State state{std::filesystem::file_size(path, size_error), std::filesystem::last_write_time(path, time_error)};
  return size_error || time_error ? State() : state;
}

void SqliteFile::Fail(const std::string& problem) const { throw InputError(path_.string() + ": " + problem); }

void SqliteFile::CheckHeader() const {
  if (main_.size == 0) Fail("is empty, not a COLMAP database");
  std::array<unsigned char, kHeaderSize> header{};
  std::ifstream file(real_path_, std::ios::binary);
  if (!file) Fail("cannot be read (permission denied?)");
  file.read(reinterpret_cast<char*>(header.data()), header.size());
  constexpr char kMagic[] = "SQLite format 3";  // with its terminating zero
  if (std::memcmp(header.data(), kMagic, sizeof(kMagic)) != 0) Fail("is not a SQLite database");
  if (main_.size < kHeaderSize) Fail("is truncated: its header is incomplete");

  // Accepts a short file with a pending WAL, which may have the missing pages.
  if (HasPendingWal()) return;
  const uint64_t page_size = BigEndian(&header[16], 2) == 1 ? 65536 : BigEndian(&header[16], 2);
  const uint64_t num_pages = BigEndian(&header[28], 4);
  // Compares two counters, because SQLite before 3.7 does not update the page count.
  const bool num_pages_is_valid = std::memcmp(&header[24], &header[92], 4) == 0;
  if (num_pages_is_valid && main_.size < page_size * num_pages) {
    Fail("is truncated: " + std::to_string(main_.size) + " of " + std::to_string(page_size * num_pages) + " bytes");
  }
}

// Fails if the journal has a header, because its transaction is in progress, or crashed and only a writer can roll it
// back.
void SqliteFile::CheckNoHotJournal() const {
  std::ifstream journal(WithSuffix(real_path_, "-journal"), std::ios::binary);
  const int first_byte = journal ? journal.get() : 0;
  if (first_byte != std::ifstream::traits_type::eof() && first_byte != 0) {
    Fail(
        "has an unfinished transaction in its -journal file: let the other program finish, or open the database "
        "once with COLMAP to roll it back");
  }
}

bool SqliteFile::HasPendingWal() const { return wal_.size > kWalHeaderSize; }

std::string SqliteFile::Uri() const {
  const std::string path = real_path_.generic_u8string();
  std::string uri = path.front() == '/' ? "file://" : "file:///";
  for (const char c : path) {
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                          std::strchr("/:._-~", c) != nullptr;
    if (is_plain) {
      uri += c;
    } else {
      uri += Format("%%%02X", static_cast<unsigned char>(c));
    }
  }
  return uri;
}

std::string SqliteFile::StateText() const {
  const auto text = [](const State& state) {
    return std::to_string(state.size) + " bytes " + std::to_string(state.modified.time_since_epoch().count());
  };
  return text(main_) + ", " + text(HasPendingWal() ? wal_ : State());
}

void SqliteFile::CheckUnchanged() const {
  const auto is_same = [](const State& a, const State& b) { return a.size == b.size && a.modified == b.modified; };
  // Ignores a WAL that appears later: nothing was read from it, and merging it into the file changes the file.
  if (!is_same(ReadState(real_path_), main_) || (HasPendingWal() && !is_same(ReadState(wal_path_), wal_))) {
    Fail("was changed by another program while it was being read");
  }
}

}  // namespace lazyloc

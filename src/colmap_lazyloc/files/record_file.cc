#include "colmap_lazyloc/files/record_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>

#include <boost/endian/conversion.hpp>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr size_t kLengthSize = sizeof(uint64_t), kHeaderSize = kLengthSize + sizeof(uint32_t);

// Returns the length and the checksum of length and record. The checksum of a header of zeros is not zero, because a
// file system may leave zeros after a power cut.
std::string MakeHeader(const std::string& record) {
  std::string header(kHeaderSize, '\0');
  auto* const bytes = reinterpret_cast<unsigned char*>(header.data());
  boost::endian::store_little_u64(bytes, record.size());
  boost::endian::store_little_u32(bytes + kLengthSize, Crc32(record, Crc32({header.data(), kLengthSize})));
  return header;
}

std::string SystemMessage() { return std::generic_category().message(errno); }

}  // namespace

RecordReader::RecordReader(const std::filesystem::path& path, uint64_t max_num_bytes)
    : path_(path), max_num_bytes_(max_num_bytes) {
  errno = 0;
  file_.open(path, std::ios::binary);
  if (!file_) throw InputError(path.string() + ": cannot be opened: " + SystemMessage());
  std::error_code error;
  num_bytes_ = std::filesystem::file_size(path, error);
  if (error) throw InputError(path.string() + ": cannot be read: " + error.message());
}

bool RecordReader::Next() {
  if (num_bytes_ - end_ < kHeaderSize) return false;
  const std::string header = ReadAt(end_, kHeaderSize);
  const uint64_t length = boost::endian::load_little_u64(reinterpret_cast<const unsigned char*>(header.data()));
  if (length > num_bytes_ - end_ - kHeaderSize) return false;
  std::string record = ReadAt(end_ + kHeaderSize, std::min(length, max_num_bytes_));
  if (record.size() == length && header != MakeHeader(record)) return false;
  record_ = std::move(record);
  offset_ = end_ + kHeaderSize;
  end_ = offset_ + length;
  return true;
}

std::string RecordReader::ReadAt(uint64_t offset, uint64_t num_bytes) {
  std::string bytes(num_bytes, '\0');
  file_.seekg(static_cast<std::streamoff>(offset));
  file_.read(bytes.data(), static_cast<std::streamsize>(num_bytes));
  if (!file_) throw InputError(path_.string() + ": cannot be read");
  return bytes;
}

RecordWriter::RecordWriter(const std::filesystem::path& path)
    : path_(path), descriptor_(open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666)) {
  if (descriptor_ < 0) Fail();
  // Goes on without a lock where the file system has none.
  if (flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    close(descriptor_);
    throw InputError(path_.string() + ": another process is writing it");
  }
}

RecordWriter::~RecordWriter() {
  if (descriptor_ >= 0) close(descriptor_);
}

void RecordWriter::Fail() const { throw InputError(path_.string() + ": cannot be written: " + SystemMessage()); }

uint64_t RecordWriter::Recover(const std::function<void(const std::string& record)>& visit) {
  RecordReader reader(path_);
  while (reader.Next()) visit(reader.Record());
  if (ftruncate(descriptor_, static_cast<off_t>(reader.NumIntactBytes())) != 0) Fail();
  Sync();
  return reader.NumBytes() - reader.NumIntactBytes();
}

void RecordWriter::Clear() {
  if (ftruncate(descriptor_, 0) != 0) Fail();
}

void RecordWriter::Append(const std::string& record) {
  const std::string bytes = MakeHeader(record) + record;
  for (size_t num_written = 0; num_written < bytes.size();) {
    const ssize_t result = write(descriptor_, bytes.data() + num_written, bytes.size() - num_written);
    if (result < 0 && errno != EINTR) Fail();
    if (result > 0) num_written += static_cast<size_t>(result);
  }
  if (std::chrono::steady_clock::now() - last_sync_ > std::chrono::seconds(1)) Sync();
}

void RecordWriter::Sync() {
  if (fsync(descriptor_) != 0) Fail();
  last_sync_ = std::chrono::steady_clock::now();
}

}  // namespace lazyloc

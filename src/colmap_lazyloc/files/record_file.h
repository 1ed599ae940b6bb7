#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>

namespace lazyloc {

// Reads a file of records, each of which has its length and a checksum in front of it, so that one that a crash or a
// full disk has cut off is told from a whole one.
class RecordReader {
 public:
  static constexpr uint64_t kWhole = ~uint64_t{0};

  // max_num_bytes: of each record that are read. Damage is not found unless all are. Throws InputError naming the file
  // if it cannot be opened.
  explicit RecordReader(const std::filesystem::path& path, uint64_t max_num_bytes = kWhole);

  // Goes to the next record. Returns false at the end of the file and at the first damaged record.
  bool Next();
  // Return the current record, and the place of its first byte in the file.
  const std::string& Record() const { return record_; }
  uint64_t Offset() const { return offset_; }
  // Returns the number of bytes up to the end of the current record, and of the whole file.
  uint64_t NumIntactBytes() const { return end_; }
  uint64_t NumBytes() const { return num_bytes_; }

  // Reads bytes from any place. Throws InputError naming the file if it does not have them.
  std::string ReadAt(uint64_t offset, uint64_t num_bytes);

 private:
  std::filesystem::path path_;
  const uint64_t max_num_bytes_;
  std::ifstream file_;
  uint64_t num_bytes_ = 0, offset_ = 0, end_ = 0;
  std::string record_;
};

// Appends records to a file. Only one process can do so at a time. Every function throws InputError naming the file.
class RecordWriter {
 public:
  // Opens the file, or makes it.
  explicit RecordWriter(const std::filesystem::path& path);
  ~RecordWriter();
  RecordWriter(const RecordWriter&) = delete;
  RecordWriter& operator=(const RecordWriter&) = delete;

  // Visits the intact records and cuts off what is behind them. Returns the number of bytes that were cut off.
  uint64_t Recover(const std::function<void(const std::string& record)>& visit);
  // Removes all records.
  void Clear();
  // Writes a record behind all others. It survives the death of the process at once and a power cut after a second.
  void Append(const std::string& record);
  // Waits until the disk has all records.
  void Sync();

 private:
  [[noreturn]] void Fail() const;

  const std::filesystem::path path_;
  int descriptor_ = -1;
  std::chrono::steady_clock::time_point last_sync_ = std::chrono::steady_clock::now();
};

}  // namespace lazyloc

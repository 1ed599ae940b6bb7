#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace lazyloc {

// A SQLite database file, judged before SQLite touches it: SQLite itself would create side files, take an empty file
// for an empty database, and notice damage only when it gets there.
class SqliteFile {
 public:
  // Throws InputError, `path: ...`, where it is missing, no SQLite database, cut short, or where an unfinished
  // transaction waits in a rollback journal.
  explicit SqliteFile(const std::filesystem::path& path);

  // As given by the user; for messages.
  const std::filesystem::path& Path() const { return path_; }
  // Whether committed changes may still be in `<path>-wal` only.
  bool HasPendingWal() const;
  // `file:` URI of the file, symbolic links resolved, without parameters.
  std::string Uri() const;
  // Throws InputError if another process has written to the file since it was opened: no lock is held on it, so what
  // was read could be a mixture of old and new.
  void CheckUnchanged() const;

 private:
  struct State {
    uintmax_t size = 0;
    std::filesystem::file_time_type modified;
  };
  static State ReadState(const std::filesystem::path& path);
  [[noreturn]] void Fail(const std::string& problem) const;
  void CheckHeader() const;
  void CheckNoHotJournal() const;

  std::filesystem::path path_, real_path_, wal_path_;
  State main_, wal_;
};

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace lazyloc {

// Checks a SQLite database file before SQLite opens it, because SQLite itself would create side files, accept an empty
// file as an empty database, and notice damage only when it reads it.
class SqliteFile {
 public:
  // Throws InputError, `path: ...`, if the file is missing, truncated or not a SQLite database, or has an unfinished
  // transaction in a rollback journal.
  explicit SqliteFile(const std::filesystem::path& path);

  // Returns the path as the user gave it, for messages.
  const std::filesystem::path& Path() const { return path_; }
  // True if committed changes may be in `<path>-wal` only.
  bool HasPendingWal() const;
  // Returns the `file:` URI of the file, with symbolic links resolved and without parameters.
  std::string Uri() const;
  // Returns the size and the time of the last change, of a WAL as well: equal if and only if nothing was written,
  // unless somebody has set the time back. A copy has another time.
  std::string StateText() const;
  // Throws InputError if another process has written to the file since it was opened, because no lock is held and what
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

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "colmap_lazyloc/database/sqlite_file.h"

struct sqlite3;
struct sqlite3_stmt;

// Wraps the part of SQLite that we need. Every failure is an InputError, one line `path: ...`; damage of one record is
// a DamagedRecordError.
namespace lazyloc {

class SqliteStatement;

// The bytes of a blob in SQLite's memory: unaligned, valid until the next row.
struct ByteSpan {
  const unsigned char* data = nullptr;
  size_t size = 0;
};

// Connects to a database without writing a byte of the file or its side files, and without creating any.
class SqliteConnection {
 public:
  explicit SqliteConnection(const std::filesystem::path& path);
  SqliteConnection(const SqliteConnection&) = delete;
  SqliteConnection& operator=(const SqliteConnection&) = delete;

  const SqliteFile& File() const { return file_; }
  // Returns the columns of a table; empty if it does not exist.
  std::set<std::string> ColumnNames(const std::string& table) const;
  // `table` is for messages. The connection must outlive the statement.
  SqliteStatement Prepare(const std::string& table, const std::string& sql) const;
  [[noreturn]] void ThrowSqliteError(const std::string& table) const;

 private:
  SqliteFile file_;
  std::shared_ptr<sqlite3> connection_;
};

// Visits the rows of one execution. The last call of Next checks that the file did not change meanwhile. If SQLite
// finds a damaged page, Next throws DamagedRecordError for a look-up, because only records on this page are affected,
// and InputError for a scan of the table, because nobody knows which rows are missing.
class SqliteRows {
 public:
  SqliteRows(const SqliteRows&) = delete;
  SqliteRows& operator=(const SqliteRows&) = delete;
  ~SqliteRows();

  bool Next();
  // Return a column of the current row, counted from 0. They fail if it is of another type.
  int64_t Integer(int column, int64_t min, int64_t max) const;
  // Returns nullopt instead of failing.
  std::optional<int64_t> IntegerOrNothing(int column, int64_t min, int64_t max) const;
  std::string Text(int column) const;
  ByteSpan Blob(int column) const;  // empty for NULL
  std::string ColumnName(int column) const;
  // Throws DamagedRecordError `path: table <table>, <row label>: <problem>`.
  [[noreturn]] void Fail(const std::string& problem) const;

 private:
  friend class SqliteStatement;
  SqliteRows(const SqliteStatement& statement, bool is_lookup, std::function<std::string()> row_label);

  const SqliteStatement& statement_;
  const bool is_lookup_;
  std::function<std::string()> row_label_;
};

class SqliteStatement {
 public:
  // Runs the statement with values for ?1, ?2, ...; only one run at a time. A statement with values is a look-up, one
  // without them a scan. `row_label` names the row in messages. `text` is the value after the numbers, unless empty.
  SqliteRows Run(std::initializer_list<int64_t> values, std::function<std::string()> row_label = nullptr,
                 const std::string& text = "") const;

 private:
  friend class SqliteConnection;
  friend class SqliteRows;
  SqliteStatement(const SqliteConnection& connection, std::string table, sqlite3_stmt* statement);

  const SqliteConnection* connection_;
  std::string table_;
  std::shared_ptr<sqlite3_stmt> statement_;
};

}  // namespace lazyloc

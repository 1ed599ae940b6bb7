#include "colmap_lazyloc/database/sqlite.h"

#include <utility>

#include <sqlite3.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

#ifdef _WIN32
constexpr char kVfsWithoutLocks[] = "win32-none";
#else
constexpr char kVfsWithoutLocks[] = "unix-none";
#endif

// True if only some pages of the file, or the sizes in one record, are wrong.
bool IsDamage(int code) { return code == SQLITE_CORRUPT || code == SQLITE_TOOBIG; }

}  // namespace

// Opens the file without leaving a trace, although COLMAP leaves databases in WAL mode, in which even a reader creates
// -wal and -shm files. Without a pending WAL, `immutable` reads the file alone. With one, exclusive mode keeps the
// index of the WAL in memory instead of in -shm. Its lock would need write access and disturb others; therefore a VFS
// without locks is used, and SqliteFile::CheckUnchanged replaces the locks.
SqliteConnection::SqliteConnection(const std::filesystem::path& path) : file_(path) {
  const bool has_wal = file_.HasPendingWal();
  const std::string uri = file_.Uri() + (has_wal ? "?mode=ro" : "?mode=ro&immutable=1");
  sqlite3* connection = nullptr;
  const int flags = SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX;
  const int code = sqlite3_open_v2(uri.c_str(), &connection, flags, has_wal ? kVfsWithoutLocks : nullptr);
  connection_.reset(connection, &sqlite3_close);
  if (code != SQLITE_OK) ThrowSqliteError("");
  // Maps no memory, because that would grow with the database and crash if another program truncates the file.
  std::string pragmas = "PRAGMA mmap_size=0;";
  if (has_wal) {
    sqlite3_db_config(connection, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
    pragmas += "PRAGMA locking_mode=EXCLUSIVE;";
  }
  if (sqlite3_exec(connection, pragmas.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) ThrowSqliteError("");
}

void SqliteConnection::ThrowSqliteError(const std::string& table) const {
  // Reports a change of the file first, because it looks like damage.
  const std::string message = connection_ ? sqlite3_errmsg(connection_.get()) : "out of memory";
  file_.CheckUnchanged();
  const std::string where = file_.Path().string() + (table.empty() ? "" : ": table " + table);
  throw InputError(AsOneLine(where + ": cannot be read: " + message));
}

std::set<std::string> SqliteConnection::ColumnNames(const std::string& table) const {
  std::set<std::string> names;
  const SqliteStatement statement = Prepare(table, "PRAGMA table_info(" + table + ")");
  SqliteRows rows = statement.Run({});
  while (rows.Next()) names.insert(rows.Text(1));
  return names;
}

SqliteStatement SqliteConnection::Prepare(const std::string& table, const std::string& sql) const {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v3(connection_.get(), sql.c_str(), -1, SQLITE_PREPARE_PERSISTENT, &statement, nullptr) !=
      SQLITE_OK) {
    ThrowSqliteError(table);
  }
  return {*this, table, statement};
}

SqliteStatement::SqliteStatement(const SqliteConnection& connection, std::string table, sqlite3_stmt* statement)
    : connection_(&connection), table_(std::move(table)), statement_(statement, &sqlite3_finalize) {}

SqliteRows SqliteStatement::Run(std::initializer_list<int64_t> values, std::function<std::string()> row_label,
                                const std::string& text) const {
  LAZYLOC_CHECK(!sqlite3_stmt_busy(statement_.get()));
  int index = 0;
  for (const int64_t value : values) {
    if (sqlite3_bind_int64(statement_.get(), ++index, value) != SQLITE_OK) connection_->ThrowSqliteError(table_);
  }
  if (!text.empty() && sqlite3_bind_text64(statement_.get(), ++index, text.data(), text.size(), SQLITE_TRANSIENT,
                                           SQLITE_UTF8) != SQLITE_OK) {
    connection_->ThrowSqliteError(table_);
  }
  return {*this, values.size() > 0, std::move(row_label)};
}

SqliteRows::SqliteRows(const SqliteStatement& statement, bool is_lookup, std::function<std::string()> row_label)
    : statement_(statement), is_lookup_(is_lookup), row_label_(std::move(row_label)) {}

SqliteRows::~SqliteRows() { sqlite3_reset(statement_.statement_.get()); }

bool SqliteRows::Next() {
  const int code = sqlite3_step(statement_.statement_.get());
  if (code == SQLITE_ROW) return true;
  if (is_lookup_ && IsDamage(code)) Fail(std::string("cannot be read: ") + sqlite3_errstr(code));
  if (code != SQLITE_DONE) statement_.connection_->ThrowSqliteError(statement_.table_);
  statement_.connection_->File().CheckUnchanged();
  return false;
}

int64_t SqliteRows::Integer(int column, int64_t min, int64_t max) const {
  sqlite3_stmt* statement = statement_.statement_.get();
  if (sqlite3_column_type(statement, column) != SQLITE_INTEGER) Fail(ColumnName(column) + " is not an integer");
  const int64_t value = sqlite3_column_int64(statement, column);
  if (value < min || value > max) Fail(ColumnName(column) + " is out of range: " + std::to_string(value));
  return value;
}

std::optional<int64_t> SqliteRows::IntegerOrNothing(int column, int64_t min, int64_t max) const {
  sqlite3_stmt* statement = statement_.statement_.get();
  if (sqlite3_column_type(statement, column) != SQLITE_INTEGER) return std::nullopt;
  const int64_t value = sqlite3_column_int64(statement, column);
  return value < min || value > max ? std::nullopt : std::make_optional(value);
}

std::string SqliteRows::Text(int column) const {
  sqlite3_stmt* statement = statement_.statement_.get();
  if (sqlite3_column_type(statement, column) != SQLITE_TEXT) Fail(ColumnName(column) + " is not text");
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement, column));
  if (text == nullptr) statement_.connection_->ThrowSqliteError(statement_.table_);
  return {text, static_cast<size_t>(sqlite3_column_bytes(statement, column))};
}

ByteSpan SqliteRows::Blob(int column) const {
  sqlite3_stmt* statement = statement_.statement_.get();
  const int type = sqlite3_column_type(statement, column);
  if (type == SQLITE_NULL) return {};
  if (type != SQLITE_BLOB) Fail(ColumnName(column) + " is not a blob");
  const auto* data = static_cast<const unsigned char*>(sqlite3_column_blob(statement, column));
  return {data, data == nullptr ? 0 : static_cast<size_t>(sqlite3_column_bytes(statement, column))};
}

void SqliteRows::Fail(const std::string& problem) const {
  const SqliteFile& file = statement_.connection_->File();
  file.CheckUnchanged();  // because a change of the file looks like damage
  const std::string row = row_label_ ? ", " + row_label_() : "";
  throw DamagedRecordError(file.Path().string(), AsOneLine("table " + statement_.table_ + row + ": " + problem));
}

std::string SqliteRows::ColumnName(int column) const {
  return sqlite3_column_name(statement_.statement_.get(), column);
}

}  // namespace lazyloc

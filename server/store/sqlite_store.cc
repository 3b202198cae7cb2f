#include "server/store/sqlite_store.h"

#include <sqlite3.h>

#include <mutex>
#include <set>
#include <utility>

namespace tessera {
namespace {

constexpr int kApplicationId = 0x54657373;  // "Tess"
constexpr int kSchemaVersion = 3;           // of the tables, and of the records in them
constexpr char kSchema[] = R"(
  CREATE TABLE records (id INTEGER PRIMARY KEY, content BLOB NOT NULL, xxh3 INTEGER NOT NULL);
  CREATE TABLE file_digests (path TEXT PRIMARY KEY, size_bytes INTEGER NOT NULL, modified_ns INTEGER NOT NULL,
                             sha256 TEXT NOT NULL) WITHOUT ROWID;
  CREATE TABLE starts (count INTEGER NOT NULL);
  INSERT INTO starts VALUES (0);
)";
// Of any version of the records: what a coordinator could not use.
constexpr char kSetAside[] = "CREATE TABLE IF NOT EXISTS set_aside (id INTEGER PRIMARY KEY, reason TEXT NOT NULL)";

Status SqliteError(const std::string& path, sqlite3* db, int code, const std::string& what) {
  const std::string message = path + ": " + what + ": " + (db != nullptr ? sqlite3_errmsg(db) : sqlite3_errstr(code));
  switch (code & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(message);
    case SQLITE_FULL:
    case SQLITE_NOMEM:
      return absl::ResourceExhaustedError(message);
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::FailedPreconditionError(message);
    default:
      return absl::InternalError(message);
  }
}

// A prepared statement that finalises itself. Binding and stepping report through codes.
class Statement {
 public:
  Statement(sqlite3* db, const char* sql) { code_ = sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr); }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  void Bind(int index, int64_t value) { Keep(sqlite3_bind_int64(statement_, index, value)); }
  void BindText(int index, const std::string& value) {
    Keep(sqlite3_bind_text(statement_, index, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT));
  }
  // `value` must live until the next Reset.
  void BindBlob(int index, std::string_view value) {
    Keep(sqlite3_bind_blob64(statement_, index, value.data(), value.size(), SQLITE_STATIC));
  }
  // SQLITE_ROW, SQLITE_DONE or an error.
  int Step() { return code_ == SQLITE_OK ? sqlite3_step(statement_) : code_; }
  // To be bound and stepped through once more; nothing is held of what was bound.
  void Reset() {
    if (statement_ == nullptr) return;
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
    code_ = SQLITE_OK;
  }
  int64_t Int(int column) { return sqlite3_column_int64(statement_, column); }
  std::string Bytes(int column) {
    const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_, column));
    return data == nullptr ? std::string()
                           : std::string(data, static_cast<size_t>(sqlite3_column_bytes(statement_, column)));
  }

 private:
  void Keep(int code) {
    if (code_ == SQLITE_OK) code_ = code;
  }
  sqlite3_stmt* statement_ = nullptr;
  int code_ = SQLITE_OK;
};

}  // namespace

struct SqliteStore::Impl {
  std::string path;
  sqlite3* db = nullptr;
  int64_t start_count = 0;
  std::mutex mutex;
  std::unique_ptr<Statement> insert;  // of records; made when first needed
  Durability durability = Durability::kMachine;

  ~Impl() {
    insert.reset();
    sqlite3_close_v2(db);
  }

  Status Error(int code, const std::string& what) const { return SqliteError(path, db, code, what); }

  Status Run(const std::string& sql) {
    const int code = sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr);
    return code == SQLITE_OK ? absl::OkStatus() : Error(code, sql.substr(0, 60));
  }

  Status Insert(const std::vector<std::string_view>& records) {
    if (insert == nullptr) {
      insert = std::make_unique<Statement>(db, "INSERT INTO records (content, xxh3) VALUES (?, ?)");
    }
    for (const std::string_view record : records) {
      insert->BindBlob(1, record);
      insert->Bind(2, static_cast<int64_t>(Xxh3(record.data(), record.size())));
      const int code = insert->Step();
      const Status status = code == SQLITE_DONE ? absl::OkStatus() : Error(code, "cannot store a record");
      insert->Reset();
      TESSERA_RETURN_IF_ERROR(status);
    }
    return absl::OkStatus();
  }

  // Of the commits from now on. Between commits that sync, the log is written but not synced: a later sync takes all
  // of it along.
  Status SetDurability(Durability wanted) {
    if (wanted == durability) return absl::OkStatus();
    TESSERA_RETURN_IF_ERROR(
        Run(wanted == Durability::kMachine ? "PRAGMA synchronous=FULL" : "PRAGMA synchronous=NORMAL"));
    durability = wanted;
    return absl::OkStatus();
  }
};

namespace {

StatusOr<int64_t> ReadNumber(sqlite3* db, const std::string& path, const char* sql) {
  Statement statement(db, sql);
  const int code = statement.Step();
  if (code != SQLITE_ROW) return SqliteError(path, db, code, sql);
  return statement.Int(0);
}

}  // namespace

SqliteStore::SqliteStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SqliteStore::~SqliteStore() = default;

StatusOr<std::unique_ptr<SqliteStore>> SqliteStore::Open(const std::string& path) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  const int code = sqlite3_open_v2(path.c_str(), &impl->db,
                                   SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX, nullptr);
  if (code != SQLITE_OK) return impl->Error(code, "cannot open");
  sqlite3_busy_timeout(impl->db, 2000);
  TESSERA_ASSIGN_OR_RETURN(const int64_t application, ReadNumber(impl->db, path, "PRAGMA application_id"));
  TESSERA_ASSIGN_OR_RETURN(const int64_t version, ReadNumber(impl->db, path, "PRAGMA user_version"));
  TESSERA_ASSIGN_OR_RETURN(const int64_t tables, ReadNumber(impl->db, path, "SELECT count(*) FROM sqlite_master"));
  if (tables > 0 && application != kApplicationId) {
    return absl::FailedPreconditionError(path + ": a database of another program");
  }
  if (tables > 0 && version != kSchemaVersion) {
    return absl::FailedPreconditionError(path + ": schema version " + std::to_string(version) + ", expected " +
                                         std::to_string(kSchemaVersion) +
                                         "; a coordinator of another version wrote it: use that, or another folder");
  }
  TESSERA_RETURN_IF_ERROR(impl->Run("PRAGMA journal_mode=WAL"));
  TESSERA_RETURN_IF_ERROR(impl->Run("PRAGMA synchronous=FULL"));
  if (tables == 0) {
    TESSERA_RETURN_IF_ERROR(impl->Run("BEGIN IMMEDIATE; PRAGMA application_id=" + std::to_string(kApplicationId) +
                                      "; PRAGMA user_version=" + std::to_string(kSchemaVersion) + ";" + kSchema +
                                      "COMMIT;"));
  }
  TESSERA_RETURN_IF_ERROR(impl->Run(kSetAside));
  {
    Statement check(impl->db, "PRAGMA quick_check(1)");
    const int step = check.Step();
    if (step != SQLITE_ROW) return impl->Error(step, "integrity check");
    if (const std::string found = check.Bytes(0); found != "ok") {
      return absl::DataLossError(path + " is damaged: " + found);
    }
  }
  TESSERA_RETURN_IF_ERROR(impl->Run("UPDATE starts SET count = count + 1"));
  TESSERA_ASSIGN_OR_RETURN(impl->start_count, ReadNumber(impl->db, path, "SELECT count FROM starts"));
  return std::unique_ptr<SqliteStore>(new SqliteStore(std::move(impl)));
}

Status SqliteStore::Append(const std::vector<std::string_view>& records, Durability durability) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(durability));
  TESSERA_RETURN_IF_ERROR(impl_->Run("BEGIN IMMEDIATE"));
  Status status = impl_->Insert(records);
  if (status.ok()) status = impl_->Run("COMMIT");
  // Some errors have done so already.
  if (!status.ok() && sqlite3_get_autocommit(impl_->db) == 0) impl_->Run("ROLLBACK").IgnoreError();
  return status;
}

Status SqliteStore::Replay(const std::function<void(const StoredRecord& record)>& visit) {
  std::lock_guard lock(impl_->mutex);
  std::set<int64_t> set_aside;
  Statement select_set_aside(impl_->db, "SELECT id FROM set_aside");
  int code = SQLITE_OK;
  while ((code = select_set_aside.Step()) == SQLITE_ROW) set_aside.insert(select_set_aside.Int(0));
  if (code != SQLITE_DONE) return impl_->Error(code, "cannot read what was set aside");
  Statement select(impl_->db, "SELECT id, content, xxh3 FROM records ORDER BY id");
  int64_t expected = 1;
  while ((code = select.Step()) == SQLITE_ROW) {
    const int64_t id = select.Int(0);
    if (id != expected && !set_aside.contains(expected)) {
      visit({expected, absl::DataLossError("missing, as are all before " + std::to_string(id))});
    }
    expected = id + 1;
    if (set_aside.contains(id)) continue;
    const std::string record = select.Bytes(1);
    if (static_cast<int64_t>(Xxh3(record)) == select.Int(2)) {
      visit({id, record});
    } else {
      visit({id, absl::DataLossError("damaged: its bytes do not fit their checksum")});
    }
  }
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot read records");
}

Status SqliteStore::SetAside(int64_t number, const std::string& reason) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kMachine));
  Statement insert(impl_->db, "INSERT OR IGNORE INTO set_aside VALUES (?, ?)");
  insert.Bind(1, number);
  insert.BindText(2, reason);
  const int code = insert.Step();
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot set a record aside");
}

int64_t SqliteStore::StartCount() const { return impl_->start_count; }

std::optional<Digest> SqliteStore::Find(const std::string& path, const FileStamp& stamp) {
  std::lock_guard lock(impl_->mutex);
  Statement select(impl_->db, "SELECT sha256 FROM file_digests WHERE path = ? AND size_bytes = ? AND modified_ns = ?");
  select.BindText(1, path);
  select.Bind(2, stamp.size_bytes);
  select.Bind(3, stamp.modified_ns);
  if (select.Step() != SQLITE_ROW) return std::nullopt;
  return Digest{select.Bytes(0), stamp.size_bytes};
}

Status SqliteStore::Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kProcess));  // what is forgotten is hashed again
  Statement insert(impl_->db, "INSERT OR REPLACE INTO file_digests VALUES (?, ?, ?, ?)");
  insert.BindText(1, path);
  insert.Bind(2, stamp.size_bytes);
  insert.Bind(3, stamp.modified_ns);
  insert.BindText(4, digest.sha256);
  const int code = insert.Step();
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot remember a digest");
}

}  // namespace tessera

#include "server/store/sqlite_store.h"

#include <sqlite3.h>

#include <atomic>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/access/secrets.h"
#include "common/storage/files.h"
#include "server/store/record_rows.h"
#include "server/store/sqlite_schema.h"
#include "server/store/sqlite_statement.h"

namespace tessera {

struct SqliteStore::Impl {
  std::string path;
  std::optional<FileLock> lock;
  std::atomic<bool> released = false;
  Database database{nullptr, sqlite3_close_v2};
  sqlite3* db = nullptr;  // `database`
  OwnerOf owner_of;
  int64_t start_count = 0;
  int64_t next_id = 1;  // of the next record
  std::mutex mutex;
  std::unique_ptr<Statement> insert;  // of records; prepared at first use
  Durability durability = Durability::kMachine;

  Status Error(int code, const std::string& what) const { return SqliteError(path, db, code, what); }

  Status Run(const std::string& sql) { return RunSql(db, path, sql); }

  Status CheckHeld() const {
    return released ? absl::AbortedError(path + ": the right to write was given up") : absl::OkStatus();
  }

  // Assign numbers here: SQLite would reuse the number of a removed record.
  Status Insert(const std::vector<std::string_view>& records) {
    if (insert == nullptr) {
      insert = std::make_unique<Statement>(db, "INSERT INTO records (id, content, xxh3, job) VALUES (?, ?, ?, ?)");
    }
    int64_t id = next_id;
    for (const std::string_view record : records) {
      const RecordOwner owner = owner_of ? owner_of(record) : RecordOwner();
      insert->Bind(1, id++);
      insert->BindBlob(2, record);
      insert->Bind(3, static_cast<int64_t>(Xxh3(record.data(), record.size())));
      insert->Bind(4, owner.deletes ? -1 : owner.job);
      const int code = insert->Step();
      Status status = code == SQLITE_DONE ? absl::OkStatus() : Error(code, "cannot store a record");
      insert->Reset();
      if (status.ok() && owner.deletes) {
        status = Run("INSERT OR IGNORE INTO deleted_jobs VALUES (" + std::to_string(owner.job) + ")");
      }
      TESSERA_RETURN_IF_ERROR(status);
    }
    return absl::OkStatus();
  }

  // Ends the open transaction: commits if `status` is OK, else rolls back unless the error has already done so.
  Status End(Status status) {
    if (status.ok()) status = Run("COMMIT");
    if (!status.ok() && sqlite3_get_autocommit(db) == 0) Run("ROLLBACK").IgnoreError();
    return status;
  }

  StatusOr<std::set<int>> DeletedJobs() {
    std::set<int> jobs;
    Statement select(db, "SELECT job FROM deleted_jobs");
    int code = SQLITE_OK;
    while ((code = select.Step()) == SQLITE_ROW) jobs.insert(static_cast<int>(select.Int(0)));
    if (code != SQLITE_DONE) return Error(code, "cannot read which jobs were deleted");
    return jobs;
  }

  // Marks [first, last] as removed and merges it with adjacent ranges.
  Status NoteRemoved(int64_t first, int64_t last) {
    Statement before(db, "SELECT first FROM removed WHERE first < ? AND last = ? - 1 ORDER BY first DESC LIMIT 1");
    before.Bind(1, first);
    before.Bind(2, first);
    if (before.Step() == SQLITE_ROW) first = before.Int(0);
    Statement after(db, "SELECT last FROM removed WHERE first = ? + 1");
    after.Bind(1, last);
    if (after.Step() == SQLITE_ROW) last = after.Int(0);
    const std::string bounds = std::to_string(first) + " AND " + std::to_string(last);
    TESSERA_RETURN_IF_ERROR(Run("DELETE FROM removed WHERE first BETWEEN " + bounds));
    return Run("INSERT INTO removed VALUES (" + std::to_string(first) + ", " + std::to_string(last) + ")");
  }

  // Sets the durability of later commits. A commit with kProcess writes the log without a sync; the next sync covers
  // it.
  Status SetDurability(Durability wanted) {
    if (wanted == durability) return absl::OkStatus();
    TESSERA_RETURN_IF_ERROR(
        Run(wanted == Durability::kMachine ? "PRAGMA synchronous=FULL" : "PRAGMA synchronous=NORMAL"));
    durability = wanted;
    return absl::OkStatus();
  }
};

SqliteStore::SqliteStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SqliteStore::~SqliteStore() = default;

StatusOr<std::unique_ptr<SqliteStore>> SqliteStore::OpenLocked(const std::string& path, OwnerOf owner_of) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  auto lock = FileLock::Acquire((folder.empty() ? "." : folder) + "/lock");
  if (!lock.ok()) {
    return Status(lock.status().code(), "cannot lock " + folder + ", probably used by another coordinator: " +
                                            std::string(lock.status().message()));
  }
  TESSERA_ASSIGN_OR_RETURN(auto store, Open(path, std::move(owner_of)));
  store->impl_->lock = *std::move(lock);
  return store;
}

StatusOr<std::unique_ptr<SqliteStore>> SqliteStore::Open(const std::string& path, OwnerOf owner_of) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->owner_of = std::move(owner_of);
  TESSERA_ASSIGN_OR_RETURN(impl->database,
                           OpenDatabase(path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX));
  impl->db = impl->database.get();
  TESSERA_RETURN_IF_ERROR(PrepareSchema(impl->db, path, impl->owner_of));
  TESSERA_ASSIGN_OR_RETURN(impl->next_id, ReadNumber(impl->db, path,
                                                     "SELECT 1 + max(ifnull((SELECT max(id) FROM records), 0),"
                                                     " ifnull((SELECT max(last) FROM removed), 0))"));
  TESSERA_RETURN_IF_ERROR(impl->Run("UPDATE starts SET count = count + 1"));
  TESSERA_ASSIGN_OR_RETURN(impl->start_count, ReadNumber(impl->db, path, "SELECT count FROM starts"));
  return std::unique_ptr<SqliteStore>(new SqliteStore(std::move(impl)));
}

Status SqliteStore::Append(const std::vector<std::string_view>& records, Durability durability) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(durability));
  TESSERA_RETURN_IF_ERROR(impl_->Run("BEGIN IMMEDIATE"));
  TESSERA_RETURN_IF_ERROR(impl_->End(impl_->Insert(records)));
  impl_->next_id += static_cast<int64_t>(records.size());
  return absl::OkStatus();
}

Status SqliteStore::Replay(const std::function<void(const StoredRecord& record)>& visit) {
  std::lock_guard lock(impl_->mutex);
  std::set<int64_t> quarantined;
  Statement select_quarantined(impl_->db, "SELECT id FROM set_aside");
  int code = SQLITE_OK;
  while ((code = select_quarantined.Step()) == SQLITE_ROW) quarantined.insert(select_quarantined.Int(0));
  if (code != SQLITE_DONE) return impl_->Error(code, "cannot read the quarantined records");
  std::map<int64_t, int64_t> removed;  // first and last
  Statement select_removed(impl_->db, "SELECT first, last FROM removed");
  while ((code = select_removed.Step()) == SQLITE_ROW) removed[select_removed.Int(0)] = select_removed.Int(1);
  if (code != SQLITE_DONE) return impl_->Error(code, "cannot read which records were removed");
  TESSERA_ASSIGN_OR_RETURN(const std::set<int> deleted, impl_->DeletedJobs());
  Statement select(impl_->db, "SELECT id, content, xxh3, job FROM records ORDER BY id");
  RecordRows rows(std::move(quarantined), std::move(removed), deleted, visit);
  while ((code = select.Step()) == SQLITE_ROW) {
    rows.Add(select.Int(0), select.Bytes(1), select.Int(2), static_cast<int>(select.Int(3)));
  }
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot read records");
}

Status SqliteStore::Quarantine(int64_t number, const std::string& reason) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kMachine));
  Statement insert(impl_->db, "INSERT OR IGNORE INTO set_aside VALUES (?, ?)");
  insert.Bind(1, number);
  insert.BindText(2, reason);
  const int code = insert.Step();
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot quarantine a record");
}

StatusOr<std::set<int>> SqliteStore::DeletedJobs() {
  std::lock_guard lock(impl_->mutex);
  return impl_->DeletedJobs();
}

StatusOr<int> SqliteStore::RemoveRecords(int max_records) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  // A removal that is lost with the machine is repeated later.
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kProcess));
  Statement select(impl_->db,
                   "SELECT id FROM records WHERE job IN (SELECT job FROM deleted_jobs) ORDER BY job, id LIMIT ?");
  select.Bind(1, max_records);
  std::set<int64_t> ids;
  int code = SQLITE_OK;
  while ((code = select.Step()) == SQLITE_ROW) ids.insert(select.Int(0));
  if (code != SQLITE_DONE) return impl_->Error(code, "cannot find records of deleted jobs");
  select.Reset();
  if (ids.empty()) return 0;
  TESSERA_RETURN_IF_ERROR(impl_->Run("BEGIN IMMEDIATE"));
  Status status;
  for (auto it = ids.begin(); status.ok() && it != ids.end();) {
    const int64_t first = *it;
    int64_t last = first;
    while (++it != ids.end() && *it == last + 1) ++last;
    status =
        impl_->Run("DELETE FROM records WHERE id BETWEEN " + std::to_string(first) + " AND " + std::to_string(last));
    if (status.ok()) status = impl_->NoteRemoved(first, last);
  }
  TESSERA_RETURN_IF_ERROR(impl_->End(std::move(status)));
  return static_cast<int>(ids.size());
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
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kProcess));  // a lost digest is computed again
  Statement insert(impl_->db, "INSERT OR REPLACE INTO file_digests VALUES (?, ?, ?, ?)");
  insert.BindText(1, path);
  insert.Bind(2, stamp.size_bytes);
  insert.Bind(3, stamp.modified_ns);
  insert.BindText(4, digest.sha256);
  const int code = insert.Step();
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot store a digest");
}

std::string SqliteStore::Location() const { return impl_->path; }

StatusOr<std::string> SqliteStore::WorkerKey() {
  const std::string file = (std::filesystem::path(impl_->path).parent_path() / "worker.key").string();
  if (!FileExists(file)) return Keep("worker_key", RandomSecret());
  TESSERA_ASSIGN_OR_RETURN(const std::string earlier, ReadSecretFile(file));
  TESSERA_ASSIGN_OR_RETURN(std::string key, Keep("worker_key", earlier));
  TESSERA_RETURN_IF_ERROR(RemoveTree(file));
  return key;
}

StatusOr<std::string> SqliteStore::Keep(const std::string& name, const std::string& value) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kMachine));
  Statement insert(impl_->db, "INSERT OR IGNORE INTO kept VALUES (?, ?)");
  insert.BindText(1, name);
  insert.BindBlob(2, value);
  if (const int code = insert.Step(); code != SQLITE_DONE) return impl_->Error(code, "cannot keep a value");
  Statement select(impl_->db, "SELECT value FROM kept WHERE name = ?");
  select.BindText(1, name);
  if (const int code = select.Step(); code != SQLITE_ROW) return impl_->Error(code, "cannot read a kept value");
  return select.Bytes(0);
}

Status SqliteStore::Replace(const std::string& name, const std::string& value) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kMachine));
  Statement insert(impl_->db, "INSERT OR REPLACE INTO kept VALUES (?, ?)");
  insert.BindText(1, name);
  insert.BindBlob(2, value);
  const int code = insert.Step();
  return code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, "cannot keep a value");
}

double SqliteStore::HeldFor_s() const { return impl_->released ? 0 : std::numeric_limits<double>::infinity(); }

Status SqliteStore::Export(const RowSink& visit) {
  std::lock_guard lock(impl_->mutex);
  for (const StateTable& table : StateTables()) {
    Statement select(impl_->db, absl::StrCat("SELECT ", ColumnsOf(table), " FROM ", table.name, " ORDER BY 1").c_str());
    int code = SQLITE_OK;
    while ((code = select.Step()) == SQLITE_ROW) {
      StateRow row;
      for (const StateTable::Column& column : table.columns) {
        const int index = static_cast<int>(row.size());
        row.push_back(column.type == StateTable::Type::kNumber ? std::to_string(select.Int(index))
                                                               : select.Bytes(index));
      }
      TESSERA_RETURN_IF_ERROR(visit(table, row));
    }
    if (code != SQLITE_DONE) return impl_->Error(code, std::string("cannot read table ") + table.name);
  }
  return absl::OkStatus();
}

Status SqliteStore::Import(const std::function<Status(const RowSink& add)>& fill, int64_t starts) {
  std::unique_lock lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->CheckHeld());
  TESSERA_RETURN_IF_ERROR(impl_->SetDurability(Durability::kMachine));
  if (impl_->next_id > 1)
    return absl::FailedPreconditionError(impl_->path + ": found records, expected an empty state");
  std::string clear;
  for (const StateTable& table : StateTables()) absl::StrAppend(&clear, "DELETE FROM ", table.name, ";");
  std::map<const StateTable*, std::unique_ptr<Statement>> inserts;
  TESSERA_RETURN_IF_ERROR(impl_->Run("BEGIN IMMEDIATE"));
  Status status = impl_->Run(clear);
  if (status.ok()) {
    status = fill([&](const StateTable& table, const StateRow& row) {
      auto& insert = inserts[&table];
      if (insert == nullptr) {
        std::string sql = absl::StrCat("INSERT INTO ", table.name, " (", ColumnsOf(table), ") VALUES (?");
        for (size_t i = 1; i < table.columns.size(); ++i) sql += ", ?";
        insert = std::make_unique<Statement>(impl_->db, (sql + ")").c_str());
      }
      for (int i = 0; i < static_cast<int>(row.size()); ++i) {
        switch (table.columns[i].type) {
          case StateTable::Type::kNumber:
            insert->Bind(i + 1, std::stoll(row[i]));
            break;
          case StateTable::Type::kText:
            insert->BindText(i + 1, row[i]);
            break;
          case StateTable::Type::kBlob:
            insert->BindBlob(i + 1, row[i]);
            break;
        }
      }
      const int code = insert->Step();
      const Status stored =
          code == SQLITE_DONE ? absl::OkStatus() : impl_->Error(code, std::string("cannot fill table ") + table.name);
      insert->Reset();
      return stored;
    });
  }
  if (status.ok()) status = impl_->Run(absl::StrCat("UPDATE starts SET count = max(count, ", starts, ")"));
  TESSERA_RETURN_IF_ERROR(impl_->End(std::move(status)));
  lock.unlock();
  Release();
  return absl::OkStatus();
}

void SqliteStore::Release() {
  std::lock_guard lock(impl_->mutex);
  impl_->released = true;
  impl_->lock.reset();
}

Status BackUp(const std::string& database, const std::string& to) {
  TESSERA_ASSIGN_OR_RETURN(const Database db, OpenDatabase(database, SQLITE_OPEN_READWRITE));
  // Worker names contain the start count. Workers of the original may still be alive when a coordinator starts from the
  // copy, so the copy must never reach a start count of the original or of another copy.
  return CopyDatabase(db.get(), database, to, "UPDATE starts SET count = count + 1048576 + (random() & 1099511627775)");
}

}  // namespace tessera

#include "server/store/sqlite_salvage.h"

#include <sqlite3.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "common/storage/files.h"
#include "common/storage/temporary_name.h"
#include "server/store/sqlite_schema.h"
#include "server/store/sqlite_statement.h"

namespace tessera {
namespace {

constexpr int64_t kNoRecord = std::numeric_limits<int64_t>::max();

// Copies records from a damaged file to a new one. Records are looked up by number, so that only those on an unreadable
// page are lost.
class Reader {
 public:
  Reader(sqlite3* from, sqlite3* to, std::string to_path, const OwnerOf& owner_of)
      : from_(from), to_(to), to_path_(std::move(to_path)), owner_of_(owner_of) {}

  StatusOr<Salvaged> Run() {
    int64_t next = 1, step = 1;
    while (next < kNoRecord / 2) {
      TESSERA_ASSIGN_OR_RETURN(const Found found, Walk(next, /*back=*/false));
      if (found.to_the_end) break;
      // Skip the damage with growing steps, then read backwards to it.
      if (found.records > 0) step = 1;
      next = std::max(next, found.last + 1) + step;
      step *= 2;
      TESSERA_RETURN_IF_ERROR(Walk(next, /*back=*/true).status());
    }
    // Small tables: copy every readable row.
    for (const char* const table : {"removed", "set_aside", "deleted_jobs", "kept"}) CopyTable(table);
    const auto starts = ReadNumber(from_, to_path_, "SELECT count FROM starts");
    TESSERA_RETURN_IF_ERROR(RunSql(
        to_, to_path_,
        "UPDATE starts SET count = 1048576 + (random() & 1099511627775) + " + std::to_string(starts.value_or(0))));
    return salvaged_;
  }

 private:
  struct Found {
    int64_t records = 0, last = 0;
    bool to_the_end = false;
  };

  // Stops at damage, at the end or, backwards, at a record that was already copied.
  StatusOr<Found> Walk(int64_t from, bool back) {
    Found found;
    Statement select(from_, back ? "SELECT id, content, xxh3 FROM records WHERE id <= ? ORDER BY id DESC"
                                 : "SELECT id, content, xxh3 FROM records WHERE id >= ? ORDER BY id");
    select.Bind(1, from);
    int code = SQLITE_OK;
    while ((code = select.Step()) == SQLITE_ROW) {
      const int64_t id = select.Int(0);
      const std::string content = select.Bytes(1);
      const RecordOwner owner = owner_of_ ? owner_of_(content) : RecordOwner();
      Statement insert(to_, "INSERT OR IGNORE INTO records (id, content, xxh3, job) VALUES (?, ?, ?, ?)");
      insert.Bind(1, id);
      insert.BindBlob(2, content);
      insert.Bind(3, select.Int(2));
      insert.Bind(4, owner.deletes ? -1 : owner.job);
      if (const int stored = insert.Step(); stored != SQLITE_DONE) {
        return SqliteError(to_path_, to_, stored, "cannot store a record");
      }
      ++found.records;
      found.last = id;
      if (sqlite3_changes(to_) == 0 && back) return found;
      if (sqlite3_changes(to_) == 0) continue;
      if (owner.deletes) {
        TESSERA_RETURN_IF_ERROR(
            RunSql(to_, to_path_, "INSERT OR IGNORE INTO deleted_jobs VALUES (" + std::to_string(owner.job) + ")"));
      }
      ++salvaged_.records;
      salvaged_.last = std::max(salvaged_.last, id);
    }
    found.to_the_end = code == SQLITE_DONE;
    return found;
  }

  void CopyTable(const std::string& table) {
    const bool pairs = table != "deleted_jobs";
    Statement select(from_, ("SELECT * FROM " + table).c_str());
    while (select.Step() == SQLITE_ROW) {
      Statement insert(to_, ("INSERT OR IGNORE INTO " + table + (pairs ? " VALUES (?, ?)" : " VALUES (?)")).c_str());
      if (table == "kept") {
        insert.BindText(1, select.Bytes(0));
        insert.BindText(2, select.Bytes(1));
        insert.Step();
        continue;
      }
      insert.Bind(1, select.Int(0));
      if (table == "set_aside") {
        insert.BindText(2, select.Bytes(1));
      } else if (pairs) {
        insert.Bind(2, select.Int(1));
      }
      insert.Step();
    }
  }

  sqlite3* const from_;
  sqlite3* const to_;
  const std::string to_path_;
  const OwnerOf& owner_of_;
  Salvaged salvaged_;
};

}  // namespace

StatusOr<Salvaged> Salvage(const std::string& path, const OwnerOf& owner_of) {
  const std::string name = UniqueName(), made = path + ".salvaged-" + name;
  StatusOr<Salvaged> salvaged = absl::UnknownError("not read");
  {
    TESSERA_ASSIGN_OR_RETURN(const Database from, OpenDatabase(path, SQLITE_OPEN_READWRITE));
    TESSERA_ASSIGN_OR_RETURN(const Database to, OpenDatabase(made, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE));
    Status status = PrepareSchema(to.get(), made, owner_of);
    if (status.ok()) status = RunSql(to.get(), made, "PRAGMA journal_mode=DELETE; BEGIN");
    if (status.ok()) salvaged = Reader(from.get(), to.get(), made, owner_of).Run();
    if (status.ok()) status = salvaged.status();
    if (status.ok() && salvaged->records == 0) status = absl::DataLossError(path + ": no record can be read");
    if (status.ok()) status = RunSql(to.get(), made, "COMMIT");
    if (!status.ok()) salvaged = status;
  }
  if (!salvaged.ok()) {
    RemoveTree(made).IgnoreError();
    return salvaged;
  }
  salvaged->damaged = path + ".damaged-" + name;
  // Move the write-ahead log too: SQLite would apply it to the new file.
  for (const char* const log : {"-wal", "-shm"}) {
    if (FileExists(path + log)) TESSERA_RETURN_IF_ERROR(RenameDurably(path + log, salvaged->damaged + log));
  }
  TESSERA_RETURN_IF_ERROR(RenameDurably(path, salvaged->damaged));
  TESSERA_RETURN_IF_ERROR(RenameDurably(made, path));
  return salvaged;
}

}  // namespace tessera

#include "server/store/postgres_store.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <mutex>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/access/secrets.h"
#include "common/base/retry/retry.h"
#include "common/storage/hash.h"
#include "server/store/postgres_connection.h"
#include "server/store/postgres_lease.h"
#include "server/store/postgres_schema.h"
#include "server/store/record_rows.h"

namespace tessera {
namespace {

constexpr double kAnswer_s = 10;       // longest wait for a statement
constexpr int kPage = 4096;            // records per statement of Replay
constexpr size_t kMaxUnsynced = 4096;  // records
constexpr double kImport_s = 300;
constexpr size_t kMaxStatement = 1 << 20;  // bytes
constexpr int kTries = 3;                  // of statements that do not write records: those are repeated by the journal

std::string Numbers(const auto& values) { return absl::StrCat("'{", absl::StrJoin(values, ","), "}'"); }

}  // namespace

struct PostgresStore::Impl {
  PostgresTarget target;
  OwnerOf owner_of;
  std::unique_ptr<PostgresLease> lease;
  std::mutex mutex;
  std::unique_ptr<PostgresConnection> connection;
  int64_t next_id = 1;  // of the next record
  // The last records before next_id, stored with Durability::kProcess since the last kMachine. A server that crashes
  // loses them; they are stored again with the first records after a new connection.
  std::vector<std::string> unsynced;
  bool reconnected = false;

  // Runs one message, on a new connection if the last one is lost.
  StatusOr<PostgresRows> RunOnce(const std::string& sql) {
    if (connection == nullptr || connection->broken()) {
      connection = nullptr;
      TESSERA_ASSIGN_OR_RETURN(connection, PostgresConnection::Open(target, kAnswer_s));
      reconnected = true;
    }
    return connection->Run(sql);
  }

  // The same, with retries: only for what may be executed twice.
  StatusOr<PostgresRows> Run(const std::string& sql) {
    StatusOr<PostgresRows> rows = absl::UnknownError("not run");
    Backoff backoff({.first_delay_s = 0.1, .max_delay_s = 1});
    for (int attempt = 1;; ++attempt) {
      rows = RunOnce(sql);
      if (!absl::IsUnavailable(rows.status()) || attempt == kTries) return rows;
      RealSleeper()(backoff.NextDelay());
    }
  }

  // A statement that writes only while the epoch is ours. `writes`: what follows the table `held`, which has one row or
  // none, in a WITH. `result`: more columns of the result, whose first is the number of rows of `held`.
  std::string Fenced(const std::string& writes, Durability durability, const std::string& result = "0") const {
    return absl::StrCat("WITH held AS (SELECT epoch FROM coordinator WHERE epoch = ", lease->epoch(), " FOR SHARE), ",
                        writes, " SELECT (SELECT count(*) FROM held), ", result,
                        durability == Durability::kProcess ? ", set_config('synchronous_commit', 'off', true)" : "");
  }

  // ABORTED if the statement found another epoch.
  Status CheckWritten(const PostgresRows& rows) {
    if (rows.Int(0, 0) == 0) lease->SetLost();
    return lease->CheckHeld();
  }

  // Runs such a statement, with retries.
  StatusOr<PostgresRows> Write(const std::string& writes, Durability durability, const std::string& result = "0") {
    TESSERA_RETURN_IF_ERROR(lease->CheckHeld());
    TESSERA_ASSIGN_OR_RETURN(PostgresRows rows, Run(Fenced(writes, durability, result)));
    TESSERA_RETURN_IF_ERROR(CheckWritten(rows));
    return rows;
  }

  StatusOr<int64_t> ReadNumber(const std::string& sql) {
    TESSERA_ASSIGN_OR_RETURN(const PostgresRows rows, Run(sql));
    return rows.Int(0, 0);
  }

  StatusOr<std::set<int>> DeletedJobs() {
    TESSERA_ASSIGN_OR_RETURN(const PostgresRows rows, Run("SELECT job FROM deleted_jobs"));
    std::set<int> jobs;
    for (int row = 0; row < rows.size(); ++row) jobs.insert(static_cast<int>(rows.Int(row, 0)));
    return jobs;
  }

  // The statement that inserts `records` with numbers from `first` on. Rows that are there stay.
  std::string InsertSql(int64_t first, const std::vector<std::string_view>& records, Durability durability) const {
    std::string contents = "'{";
    std::vector<int64_t> hashes;
    std::vector<int> jobs;
    std::set<int> deleted;
    for (const std::string_view record : records) {
      contents += contents.size() > 2 ? ",\"\\\\x" : "\"\\\\x";
      AppendHex(contents, record);
      contents += '"';
      hashes.push_back(static_cast<int64_t>(Xxh3(record.data(), record.size())));
      const RecordOwner owner = owner_of ? owner_of(record) : RecordOwner();
      jobs.push_back(owner.deletes ? -1 : owner.job);
      if (owner.deletes) deleted.insert(owner.job);
    }
    contents += "}'";
    std::string writes = absl::StrCat("put AS (INSERT INTO records SELECT ", first,
                                      " + number - 1, content, xxh3, job FROM held, unnest(", contents, "::bytea[], ",
                                      Numbers(hashes), "::bigint[], ", Numbers(jobs),
                                      "::int[]) WITH ORDINALITY AS record (content, xxh3, job, number)"
                                      " ON CONFLICT (id) DO NOTHING RETURNING 1)");
    if (!deleted.empty()) {
      absl::StrAppend(&writes, ", deleted AS (INSERT INTO deleted_jobs SELECT unnest(", Numbers(deleted),
                      "::int[]) FROM held ON CONFLICT DO NOTHING)");
    }
    return Fenced(writes, durability, "(SELECT count(*) FROM put)");
  }

  // ABORTED unless the stored records from `first` on are these.
  Status CheckStored(int64_t first, const std::vector<std::string_view>& records) {
    TESSERA_ASSIGN_OR_RETURN(const PostgresRows rows,
                             RunOnce(absl::StrCat("SELECT content FROM records WHERE id BETWEEN ", first, " AND ",
                                                  first + static_cast<int64_t>(records.size()) - 1, " ORDER BY id")));
    bool same = rows.size() == static_cast<int>(records.size());
    for (int row = 0; same && row < rows.size(); ++row) same = rows.Bytes(row, 0) == records[row];
    return same ? absl::OkStatus()
                : absl::AbortedError(absl::StrCat(target.location,
                                                  ": found other records than those of this process "
                                                  "from number ",
                                                  first, " on"));
  }

  Status Append(const std::vector<std::string_view>& records, Durability durability) {
    TESSERA_RETURN_IF_ERROR(lease->CheckHeld());
    if (unsynced.size() + records.size() > kMaxUnsynced) durability = Durability::kMachine;
    // If the connection breaks in here, the next call stores all of it again.
    std::vector<std::string_view> batch;
    if (connection == nullptr || connection->broken() || reconnected) batch.assign(unsynced.begin(), unsynced.end());
    const int64_t first = next_id - static_cast<int64_t>(batch.size());
    batch.insert(batch.end(), records.begin(), records.end());
    TESSERA_ASSIGN_OR_RETURN(const PostgresRows rows, RunOnce(InsertSql(first, batch, durability)));
    TESSERA_RETURN_IF_ERROR(CheckWritten(rows));
    if (rows.Int(0, 1) != static_cast<int64_t>(batch.size())) TESSERA_RETURN_IF_ERROR(CheckStored(first, batch));
    reconnected = false;
    next_id += static_cast<int64_t>(records.size());
    if (durability == Durability::kMachine) {
      unsynced.clear();
    } else {
      unsynced.insert(unsynced.end(), records.begin(), records.end());
    }
    return absl::OkStatus();
  }
};

PostgresStore::PostgresStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PostgresStore::~PostgresStore() = default;

StatusOr<std::unique_ptr<PostgresStore>> PostgresStore::Open(const std::string& url, const OpenStateOptions& options) {
  auto impl = std::make_unique<Impl>();
  TESSERA_ASSIGN_OR_RETURN(impl->target, ParsePostgresUrl(url));
  impl->owner_of = options.owner_of;
  TESSERA_RETURN_IF_ERROR(PreparePostgresSchema(impl->target));
  TESSERA_ASSIGN_OR_RETURN(impl->lease, PostgresLease::Take(impl->target, options));
  TESSERA_ASSIGN_OR_RETURN(impl->next_id, impl->ReadNumber("SELECT 1 + greatest((SELECT max(id) FROM records),"
                                                           " (SELECT max(last) FROM removed), 0)"));
  return std::unique_ptr<PostgresStore>(new PostgresStore(std::move(impl)));
}

Status PostgresStore::Append(const std::vector<std::string_view>& records, Durability durability) {
  std::lock_guard lock(impl_->mutex);
  return impl_->Append(records, durability);
}

Status PostgresStore::Replay(const std::function<void(const StoredRecord& record)>& visit) {
  std::lock_guard lock(impl_->mutex);
  std::set<int64_t> quarantined;
  std::map<int64_t, int64_t> removed;
  TESSERA_ASSIGN_OR_RETURN(PostgresRows rows, impl_->Run("SELECT id FROM set_aside"));
  for (int row = 0; row < rows.size(); ++row) quarantined.insert(rows.Int(row, 0));
  TESSERA_ASSIGN_OR_RETURN(rows, impl_->Run("SELECT first, last FROM removed"));
  for (int row = 0; row < rows.size(); ++row) removed[rows.Int(row, 0)] = rows.Int(row, 1);
  TESSERA_ASSIGN_OR_RETURN(std::set<int> deleted, impl_->DeletedJobs());
  RecordRows records(std::move(quarantined), std::move(removed), std::move(deleted), visit);
  for (int64_t after = 0;;) {
    TESSERA_ASSIGN_OR_RETURN(rows, impl_->Run(absl::StrCat("SELECT id, content, xxh3, job FROM records WHERE id > ",
                                                           after, " ORDER BY id LIMIT ", kPage)));
    if (rows.size() == 0) return absl::OkStatus();
    for (int row = 0; row < rows.size(); ++row) {
      records.Add(rows.Int(row, 0), rows.Bytes(row, 1), rows.Int(row, 2), static_cast<int>(rows.Int(row, 3)));
    }
    after = rows.Int(rows.size() - 1, 0);
  }
}

Status PostgresStore::Quarantine(int64_t number, const std::string& reason) {
  std::lock_guard lock(impl_->mutex);
  return impl_
      ->Write(absl::StrCat("put AS (INSERT INTO set_aside SELECT ", number, ", ", SqlBytes(reason),
                           " FROM held ON CONFLICT DO NOTHING)"),
              Durability::kMachine)
      .status();
}

StatusOr<std::set<int>> PostgresStore::DeletedJobs() {
  std::lock_guard lock(impl_->mutex);
  return impl_->DeletedJobs();
}

StatusOr<int> PostgresStore::RemoveRecords(int max_records) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->lease->CheckHeld());
  TESSERA_ASSIGN_OR_RETURN(PostgresRows rows,
                           impl_->Run(absl::StrCat("SELECT id FROM records WHERE job IN (SELECT job FROM deleted_jobs)"
                                                   " ORDER BY job, id LIMIT ",
                                                   max_records)));
  std::set<int64_t> ids;
  for (int row = 0; row < rows.size(); ++row) ids.insert(rows.Int(row, 0));
  if (ids.empty()) return 0;
  // The new ranges and those that they touch, merged.
  std::map<int64_t, int64_t> ranges, touched;
  for (auto it = ids.begin(); it != ids.end();) {
    const int64_t first = *it;
    int64_t last = first;
    while (++it != ids.end() && *it == last + 1) ++last;
    ranges[first] = last;
  }
  const std::string all = Numbers(ids);
  TESSERA_ASSIGN_OR_RETURN(rows, impl_->Run(absl::StrCat("SELECT first, last FROM removed WHERE last + 1 = ANY(", all,
                                                         "::bigint[]) OR first - 1 = ANY(", all, "::bigint[])")));
  for (int row = 0; row < rows.size(); ++row) touched[rows.Int(row, 0)] = rows.Int(row, 1);
  ranges.insert(touched.begin(), touched.end());
  for (auto it = ranges.begin(); it != ranges.end();) {
    const auto next = std::next(it);
    if (next != ranges.end() && next->first == it->second + 1) {
      it->second = next->second;
      ranges.erase(next);
    } else {
      ++it;
    }
  }
  std::vector<int64_t> firsts, lasts, absorbed;
  for (const auto& [first, last] : ranges) {
    firsts.push_back(first);
    lasts.push_back(last);
  }
  for (const auto& [first, last] : touched) {
    if (!ranges.contains(first)) absorbed.push_back(first);
  }
  TESSERA_RETURN_IF_ERROR(
      impl_
          ->Write(absl::StrCat("gone AS (DELETE FROM records USING held WHERE id = ANY(", all, "::bigint[])), ",
                               "absorbed AS (DELETE FROM removed USING held WHERE first = ANY(", Numbers(absorbed),
                               "::bigint[])), put AS (INSERT INTO removed SELECT range.* FROM held, unnest(",
                               Numbers(firsts), "::bigint[], ", Numbers(lasts),
                               "::bigint[]) AS range ON CONFLICT (first) DO UPDATE SET last = excluded.last)"),
                  Durability::kMachine)
          .status());
  impl_->unsynced.clear();  // durable now, and some may be removed
  return static_cast<int>(ids.size());
}

int64_t PostgresStore::StartCount() const { return impl_->lease->epoch(); }

std::optional<Digest> PostgresStore::Find(const std::string& path, const FileStamp& stamp) {
  std::lock_guard lock(impl_->mutex);
  const auto rows =
      impl_->RunOnce(absl::StrCat("SELECT sha256 FROM file_digests WHERE path = ", SqlBytes(path),
                                  " AND size_bytes = ", stamp.size_bytes, " AND modified_ns = ", stamp.modified_ns));
  if (!rows.ok() || rows->size() == 0) return std::nullopt;
  return Digest{rows->Bytes(0, 0), stamp.size_bytes};
}

Status PostgresStore::Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) {
  std::lock_guard lock(impl_->mutex);
  return impl_
      ->Write(absl::StrCat("put AS (INSERT INTO file_digests SELECT ", SqlBytes(path), ", ", stamp.size_bytes, ", ",
                           stamp.modified_ns, ", ", SqlBytes(digest.sha256),
                           " FROM held ON CONFLICT (path) DO UPDATE SET size_bytes = excluded.size_bytes,"
                           " modified_ns = excluded.modified_ns, sha256 = excluded.sha256)"),
              Durability::kProcess)
      .status();
}

std::string PostgresStore::Location() const { return impl_->target.location; }

StatusOr<std::string> PostgresStore::WorkerKey() { return Keep("worker_key", RandomSecret()); }

StatusOr<std::string> PostgresStore::Keep(const std::string& name, const std::string& value) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_ASSIGN_OR_RETURN(
      const PostgresRows rows,
      impl_->Write(absl::StrCat("put AS (INSERT INTO kept SELECT ", SqlBytes(name), ", ", SqlBytes(value),
                                " FROM held ON CONFLICT DO NOTHING RETURNING value)"),
                   Durability::kMachine,
                   absl::StrCat("coalesce((SELECT value FROM put), (SELECT value FROM kept WHERE name = ",
                                SqlBytes(name), "))")));
  return rows.Bytes(0, 1);
}

Status PostgresStore::Replace(const std::string& name, const std::string& value) {
  std::lock_guard lock(impl_->mutex);
  return impl_
      ->Write(absl::StrCat("put AS (INSERT INTO kept SELECT ", SqlBytes(name), ", ", SqlBytes(value),
                           " FROM held ON CONFLICT (name) DO UPDATE SET value = excluded.value)"),
              Durability::kMachine)
      .status();
}

double PostgresStore::HeldFor_s() const { return impl_->lease->HeldFor_s(); }

Status PostgresStore::Export(const RowSink& visit) {
  std::lock_guard lock(impl_->mutex);
  for (const StateTable& table : StateTables()) {
    const auto is_number = [&](size_t column) { return table.columns[column].type == StateTable::Type::kNumber; };
    const std::string select = absl::StrCat("SELECT ", ColumnsOf(table), " FROM ", table.name);
    for (std::string after;;) {
      TESSERA_ASSIGN_OR_RETURN(const PostgresRows rows,
                               impl_->Run(absl::StrCat(select, after, " ORDER BY 1 LIMIT ", kPage)));
      if (rows.size() == 0) break;
      StateRow values;
      for (int row = 0; row < rows.size(); ++row) {
        values.clear();
        for (size_t i = 0; i < table.columns.size(); ++i) {
          const int column = static_cast<int>(i);
          values.push_back(is_number(i) ? rows.Text(row, column) : rows.Bytes(row, column));
        }
        TESSERA_RETURN_IF_ERROR(visit(table, values));
      }
      after = absl::StrCat(" WHERE ", table.columns[0].name, " > ", is_number(0) ? values[0] : SqlBytes(values[0]));
    }
  }
  return absl::OkStatus();
}

// One transaction on a connection of its own. It locks the row of the epoch only at its end.
Status PostgresStore::Import(const std::function<Status(const RowSink& add)>& fill, int64_t starts) {
  std::lock_guard lock(impl_->mutex);
  TESSERA_RETURN_IF_ERROR(impl_->lease->CheckHeld());
  if (impl_->next_id > 1) {
    return absl::FailedPreconditionError(impl_->target.location + ": found records, expected an empty state");
  }
  TESSERA_ASSIGN_OR_RETURN(const auto connection, PostgresConnection::Open(impl_->target, kImport_s));
  std::string sql = "BEGIN";
  for (const StateTable& table : StateTables()) absl::StrAppend(&sql, "; DELETE FROM ", table.name);
  TESSERA_RETURN_IF_ERROR(connection->Run(sql).status());
  const StateTable* filled = nullptr;  // of the rows in `sql`
  const auto send = [&] { return filled != nullptr ? connection->Run(sql).status() : absl::OkStatus(); };
  TESSERA_RETURN_IF_ERROR(fill([&](const StateTable& table, const StateRow& row) {
    const bool next = filled != &table || sql.size() > kMaxStatement;
    if (next) {
      TESSERA_RETURN_IF_ERROR(send());
      sql = absl::StrCat("INSERT INTO ", table.name, " (", ColumnsOf(table), ") VALUES ");
      filled = &table;
    }
    for (size_t i = 0; i < row.size(); ++i) {
      absl::StrAppend(&sql,
                      i > 0  ? ", "
                      : next ? "("
                             : ", (",
                      table.columns[i].type == StateTable::Type::kNumber ? row[i] : SqlBytes(row[i]));
    }
    sql += ")";
    return Status();
  }));
  TESSERA_RETURN_IF_ERROR(send());
  TESSERA_ASSIGN_OR_RETURN(const PostgresRows ours,
                           connection->Run(absl::StrCat("UPDATE coordinator SET epoch = greatest(epoch + 1, ", starts,
                                                        "), holder = '', renewed = to_timestamp(0) WHERE epoch = ",
                                                        impl_->lease->epoch(), " RETURNING epoch")));
  impl_->lease->SetLost();  // by whoever opens the state next, if not before
  if (ours.size() == 0) return impl_->lease->CheckHeld();
  return connection->Run("COMMIT").status();
}

void PostgresStore::Release() { impl_->lease->Release(); }

StatusOr<std::optional<std::string>> ReadKept(const std::string& url, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(PostgresTarget target, ParsePostgresUrl(url));
  TESSERA_ASSIGN_OR_RETURN(const bool exists, FindPostgresSchema(target));
  if (!exists) return std::nullopt;
  TESSERA_ASSIGN_OR_RETURN(const auto connection, PostgresConnection::Open(target, kAnswer_s));
  TESSERA_ASSIGN_OR_RETURN(const PostgresRows rows,
                           connection->Run(absl::StrCat("SELECT value FROM kept WHERE name = ", SqlBytes(name))));
  if (rows.size() == 0) return std::nullopt;
  return rows.Bytes(0, 0);
}

}  // namespace tessera

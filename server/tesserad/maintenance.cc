#include "server/tesserad/maintenance.h"

#include <unistd.h>

#include <filesystem>
#include <iostream>

#include "common/base/clock.h"
#include "common/storage/files.h"
#include "server/jobs/coordinator.h"
#include "server/ledger/record_owner.h"
#include "server/retention/blob_collector.h"
#include "server/retention/verify_state.h"
#include "server/store/sqlite_salvage.h"
#include "server/store/sqlite_store.h"
#include "server/store/state_copy.h"
#include "server/store/state_store.h"
#include "server/tesserad/logging.h"

namespace tessera {
namespace {

Status CheckIsData(const std::string& data) {
  if (FileExists(data + "/state.sqlite")) return absl::OkStatus();
  return absl::InvalidArgumentError(data + ": found no state.sqlite, expected a data folder of tesserad");
}

Status CheckIsSqlite(const std::string& state, const std::string& option, const std::string& instead) {
  if (state.empty()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      option + " is only for the state in a data folder; use PostgreSQL's own tools: " + instead);
}

StatusOr<FileLock> LockUnused(const std::string& data) {
  TESSERA_RETURN_IF_ERROR(CheckIsData(data));
  StatusOr<FileLock> lock = FileLock::Acquire(data + "/lock");
  if (lock.ok()) return lock;
  return Status(lock.status().code(), "a coordinator uses " + data + ": stop it first, or use a backup (" +
                                          std::string(lock.status().message()) + ")");
}

// Opens the state, which must not be in use.
StatusOr<std::unique_ptr<StateStore>> OpenUnused(const std::string& data, const std::string& state) {
  if (!state.empty() && !IsPostgresUrl(state)) {
    return InputError("--state", "", "'" + state + "'",
                      "postgresql://HOST/DATABASE; without it, the state is DATA/state.sqlite");
  }
  if (state.empty()) TESSERA_RETURN_IF_ERROR(LockUnused(data).status());
  return OpenState(state.empty() ? data + "/state.sqlite" : state,
                   {.owner_of = OwnerOfRecord, .holder = "maintenance, process " + std::to_string(::getpid())});
}

}  // namespace

Status BackUpData(const std::string& data, const std::string& state, const std::string& to) {
  TESSERA_RETURN_IF_ERROR(CheckIsSqlite(state, "--backup", "pg_dump copies a database that is in use"));
  TESSERA_RETURN_IF_ERROR(CheckIsData(data));
  TESSERA_RETURN_IF_ERROR(BackUp(data + "/state.sqlite", std::filesystem::absolute(to).string()));
  std::cout << to << " written\n";
  return absl::OkStatus();
}

Status VerifyData(const std::string& data, const std::string& state, const BlobFlags& blob_flags, bool deep) {
  TESSERA_ASSIGN_OR_RETURN(const auto store, OpenUnused(data, state));
  SystemClock clock;
  TESSERA_ASSIGN_OR_RETURN(const OpenedBlobs opened, OpenBlobs(blob_flags, data, CollectorOptions().grace_s, &clock));
  BlobStore* const blobs = opened.store.get();
  const auto tell = [](const std::string& fault) { std::cout << fault << "\n"; };
  TESSERA_ASSIGN_OR_RETURN(const StateSummary found, VerifyState(*store, *blobs, deep, tell));
  std::cout << found.records << " records, " << found.jobs << " jobs, " << found.blobs << " blobs";
  if (found.spare > 0) std::cout << " (" << found.spare << " removed: recomputed on demand)";
  std::cout << ", " << found.faults << " faults\n";
  if (found.faults == 0) return absl::OkStatus();
  Planner planner;
  DispatchEnvironment environment{store.get(), blobs, &planner, &clock, LogRecord};
  environment.on_record_quarantined = [](int64_t number, const std::string&) {
    std::cout << "record " << number << " quarantined\n";
  };
  TESSERA_RETURN_IF_ERROR(Coordinator::QuarantineUnusable(environment));
  return absl::DataLossError(
      store->Location() + ": " + std::to_string(found.faults) +
      " faults; damaged items are quarantined, and missing files are recomputed when a task reads them");
}

Status SalvageData(const std::string& data, const std::string& state) {
  TESSERA_RETURN_IF_ERROR(CheckIsSqlite(
      state, "--salvage", "restore a dump of pg_dump, or see pg_amcheck and zero_damaged_pages in its manual"));
  TESSERA_ASSIGN_OR_RETURN(const FileLock lock, LockUnused(data));
  TESSERA_ASSIGN_OR_RETURN(const Salvaged salvaged, Salvage(data + "/state.sqlite", OwnerOfRecord));
  std::cout << salvaged.records << " records of " << salvaged.last << " are readable; the damaged file is now "
            << salvaged.damaged << "\n";
  return absl::OkStatus();
}

Status CopyStateTo(const std::string& data, const std::string& state, const std::string& to) {
  TESSERA_ASSIGN_OR_RETURN(const auto from, OpenUnused(data, state));
  TESSERA_ASSIGN_OR_RETURN(const auto target,
                           OpenState(IsPostgresUrl(to) ? to : AbsolutePath(to),
                                     {.owner_of = OwnerOfRecord, .holder = "copy of " + from->Location()}));
  TESSERA_ASSIGN_OR_RETURN(const int64_t records, CopyState(*from, *target));
  std::cout << records << " records copied from " << from->Location() << " to " << target->Location()
            << "; start the coordinator with the copy, and do not use the original again\n";
  return absl::OkStatus();
}

}  // namespace tessera

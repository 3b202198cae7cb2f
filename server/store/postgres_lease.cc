#include "server/store/postgres_lease.h"

#include <time.h>
#include <unistd.h>

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/base/retry/retry.h"

namespace tessera {
namespace {

constexpr double kRenewal_s = 2, kOver_s = 6, kHeld_s = 4;
constexpr double kLook_s = 0.25;
constexpr double kStatement_s = 2;

// Unlike steady_clock it goes on while the machine is suspended.
int64_t BootTimeUs() {
  timespec time = {};
  ::clock_gettime(CLOCK_BOOTTIME, &time);
  return int64_t{1'000'000} * time.tv_sec + time.tv_nsec / 1000;
}

int64_t HeldUntilUs(int64_t begun_us) { return begun_us + static_cast<int64_t>(kHeld_s * 1e6); }

RetryPolicy Retries() { return {.first_delay_s = 0.1, .max_delay_s = 1, .seed = static_cast<uint64_t>(::getpid())}; }

// Takes the lease if it is free. Returns the new epoch, or NULL, and who held it and the seconds since its renewal. The
// epoch is a time, in microseconds, so that it also rises if the table is restored from an old dump.
std::string TakeSql(const std::string& holder) {
  return absl::StrCat(
      "WITH taken AS (UPDATE coordinator SET epoch = greatest(epoch + 1,"
      " (extract(epoch FROM clock_timestamp()) * 1000000)::bigint), holder = ",
      SqlText(Printable(holder)), ", renewed = clock_timestamp() WHERE renewed <= clock_timestamp() - interval '",
      kOver_s,
      " s' RETURNING epoch) SELECT (SELECT epoch FROM taken), holder, extract(epoch FROM clock_timestamp() - renewed)"
      " FROM coordinator");
}

}  // namespace

StatusOr<std::unique_ptr<PostgresLease>> PostgresLease::Take(const PostgresTarget& target,
                                                             const OpenStateOptions& options) {
  TESSERA_ASSIGN_OR_RETURN(auto connection, PostgresConnection::Open(target, kStatement_s));
  Backoff backoff(Retries());
  std::string holder = "unknown";
  double renewed_before_s = 0;
  while (true) {
    const int64_t begun_us = BootTimeUs();
    const auto rows = connection->Run(TakeSql(options.holder));
    if (rows.ok() && rows->size() != 1) {
      return absl::DataLossError(target.location + ": the row of table coordinator is missing");
    }
    if (rows.ok() && !rows->IsNull(0, 0)) {
      return std::unique_ptr<PostgresLease>(
          new PostgresLease(target, std::move(connection), rows->Int(0, 0), begun_us));
    }
    if (rows.ok()) {
      backoff.Reset();
      holder = rows->Text(0, 1);
      renewed_before_s = rows->Real(0, 2);
    } else if (rows.status().code() != absl::StatusCode::kUnavailable || !options.wait) {
      return rows.status();
    }
    if (!options.wait) {
      return absl::FailedPreconditionError(absl::StrCat(target.location, ": in use by the coordinator ",
                                                        Printable(holder), ", which renewed its lease ",
                                                        static_cast<int>(renewed_before_s), " s ago; stop it first"));
    }
    if (!options.wait(holder, renewed_before_s)) return absl::CancelledError("the wait for the state was ended");
    RealSleeper()(rows.ok() ? kLook_s : backoff.NextDelay());
    if (connection->broken()) {
      if (auto opened = PostgresConnection::Open(target, kStatement_s); opened.ok()) connection = *std::move(opened);
    }
  }
}

PostgresLease::PostgresLease(const PostgresTarget& target, std::unique_ptr<PostgresConnection> connection,
                             int64_t epoch, int64_t begun_us)
    : target_(target),
      epoch_(epoch),
      connection_(std::move(connection)),
      held_until_us_(HeldUntilUs(begun_us)),
      thread_([this] { Run(); }) {}

PostgresLease::~PostgresLease() { Release(); }

double PostgresLease::HeldFor_s() const {
  if (lost_ || released_) return 0;
  return 1e-6 * static_cast<double>(held_until_us_ - BootTimeUs());
}

Status PostgresLease::CheckHeld() const {
  if (lost_) return absl::AbortedError(target_.location + ": another coordinator has taken over");
  return released_ ? absl::AbortedError(target_.location + ": the right to write was given up") : absl::OkStatus();
}

void PostgresLease::SetLost() { lost_ = true; }

// ABORTED if the epoch is another.
Status PostgresLease::Renew() {
  if (connection_->broken()) {
    TESSERA_ASSIGN_OR_RETURN(connection_, PostgresConnection::Open(target_, kStatement_s));
  }
  const int64_t begun_us = BootTimeUs();
  TESSERA_ASSIGN_OR_RETURN(
      const PostgresRows rows,
      connection_->Run(absl::StrCat("UPDATE coordinator SET renewed = clock_timestamp() WHERE epoch = ", epoch_,
                                    " RETURNING epoch")));
  if (rows.size() == 0) return absl::AbortedError("");
  held_until_us_ = HeldUntilUs(begun_us);
  return absl::OkStatus();
}

void PostgresLease::Run() {
  Backoff backoff(Retries());
  double pause_s = kRenewal_s;
  std::unique_lock lock(mutex_);
  while (!ended_.wait_for(lock, std::chrono::duration<double>(pause_s), [this] { return released_ || lost_; })) {
    lock.unlock();
    const Status renewed = Renew();
    lock.lock();
    if (renewed.ok()) backoff.Reset();
    if (absl::IsAborted(renewed)) lost_ = true;
    pause_s = renewed.ok() ? kRenewal_s : backoff.NextDelay();
  }
}

void PostgresLease::Release() {
  {
    std::lock_guard lock(mutex_);
    if (released_.exchange(true)) return;
  }
  ended_.notify_all();
  thread_.join();
  if (lost_) return;
  if (connection_->broken()) {
    auto opened = PostgresConnection::Open(target_, kStatement_s);
    if (!opened.ok()) return;
    connection_ = *std::move(opened);
  }
  connection_->Run(absl::StrCat("UPDATE coordinator SET renewed = to_timestamp(0), holder = '' WHERE epoch = ", epoch_))
      .IgnoreError();
}

}  // namespace tessera

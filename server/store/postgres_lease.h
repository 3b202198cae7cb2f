// The exclusive right to write a state in PostgreSQL, as a lease that is renewed.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "common/base/status.h"
#include "server/store/postgres_connection.h"
#include "server/store/state_store.h"

namespace tessera {

// Renewed every 2 s by a thread with a connection of its own. Over, for others, 6 s after its last renewal by the
// database's clock; for its holder, 4 s after it began that renewal, by CLOCK_BOOTTIME. Thread-safe.
class PostgresLease {
 public:
  // Raises the epoch as soon as nobody holds the lease; see OpenStateOptions.
  static StatusOr<std::unique_ptr<PostgresLease>> Take(const PostgresTarget& target, const OpenStateOptions& options);
  // Releases it.
  ~PostgresLease();

  // Never the same for two openings, also if the database was restored from a dump in between.
  int64_t epoch() const { return epoch_; }
  // Without waiting.
  double HeldFor_s() const;
  // ABORTED if the lease was released or another coordinator has taken it.
  Status CheckHeld() const;
  // A statement found another epoch.
  void SetLost();
  // Lets another coordinator take it at once. Takes at most some seconds.
  void Release();

 private:
  PostgresLease(const PostgresTarget& target, std::unique_ptr<PostgresConnection> connection, int64_t epoch,
                int64_t begun_us);
  void Run();
  Status Renew();

  const PostgresTarget target_;
  const int64_t epoch_;
  std::unique_ptr<PostgresConnection> connection_;  // of the thread
  std::atomic<int64_t> held_until_us_;
  std::atomic<bool> lost_ = false, released_ = false;
  std::mutex mutex_;
  std::condition_variable ended_;
  std::thread thread_;
};

}  // namespace tessera

// Limits per client. A client is the name of a token or, without tokens, an address; all callers through Unix sockets
// are one client.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "common/base/status.h"
#include "common/storage/blob_store.h"

namespace tessera {

struct ClientLimitOptions {
  int watches = 1000;        // open watches of a client
  int transfers = 256;       // concurrent calls that transfer blobs or read a scene, of a client or a worker
  int all_transfers = 1500;  // of all clients; each uses a thread
  int uploads = 10'000;      // unfinished uploads of a client
  int64_t upload_bytes = int64_t{1} << 40;  // total size of a client's unfinished uploads when complete
  double silence_s = 120;                   // a transfer without progress for this long is aborted
};

// Refuses with RESOURCE_EXHAUSTED and Refusal::kLimit: the limit, the flag that sets it, and when to retry.
// Thread-safe.
class ClientLimits {
 public:
  using Clock = std::chrono::steady_clock;

  // `blobs` must outlive this.
  ClientLimits(const ClientLimitOptions& options, const BlobStore* blobs) : options_(options), blobs_(blobs) {}

  // Counts toward a limit until it is destroyed. Must not outlive its ClientLimits.
  class Ticket {
   public:
    Ticket() = default;
    Ticket(Ticket&& other) noexcept { *this = std::move(other); }
    Ticket& operator=(Ticket&& other) noexcept;
    ~Ticket() { Return(); }
    // Call when data of the transfer moved.
    void Moved();

   private:
    friend class ClientLimits;
    struct Entry {
      std::string client;
      bool is_watch = false;
      std::function<void()> break_off;
      Clock::time_point moved = {};
    };
    Ticket(ClientLimits* limits, std::list<Entry>::iterator entry) : limits_(limits), entry_(entry) {}
    void Return();
    ClientLimits* limits_ = nullptr;
    std::list<Entry>::iterator entry_;
  };

  StatusOr<Ticket> Watch(const std::string& client);
  // `break_off` is called, from any thread, if the transfer makes no progress for silence_s; never after the ticket was
  // returned. It must be quick. Empty: the transfer may be silent (reading a scene).
  StatusOr<Ticket> Transfer(const std::string& client, std::function<void()> break_off);
  // Number of running transfers.
  int transfers() const;
  // Call about once a second.
  void BreakOffSilent(Clock::time_point now);

  // A client begins an upload or resumes one that any client began. Uploads of earlier processes are not counted.
  Status BeginUpload(const std::string& client, const Digest& digest);
  // The upload is complete or was removed.
  void EndUpload(const Digest& digest);

 private:
  struct Upload {
    std::string client;
    int64_t bytes = 0;
  };
  struct Uploads {
    int count = 0;
    int64_t bytes = 0;
  };
  void EndUploadLocked(std::map<std::string, Upload>::iterator upload);
  // Releases the lock while it asks the blob store.
  void ForgetSwept(const std::string& client, Clock::time_point now, std::unique_lock<std::mutex>& lock);

  const ClientLimitOptions options_;
  const BlobStore* const blobs_;
  mutable std::mutex mutex_;
  std::list<Ticket::Entry> tickets_;
  std::map<std::string, int> watches_, transfers_;  // by client; no entry is 0
  int all_transfers_ = 0;
  std::map<std::string, Upload> uploads_;             // by SHA-256
  std::map<std::string, Uploads> uploads_of_client_;  // no count is 0
  Clock::time_point swept_at_ = {};
};

}  // namespace tessera

// What one client may have at once. A client is whose token it is; where nobody is asked for one, the address that he
// calls from; all who come through sockets are one.
#ifndef TESSERA_SERVER_AUTH_CLIENT_LIMITS_H_
#define TESSERA_SERVER_AUTH_CLIENT_LIMITS_H_

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
  int watches = 1000;        // of a client
  int transfers = 256;       // calls that move blobs or read a scene, of a client or of one worker, at once
  int all_transfers = 1500;  // each of them holds a thread
  int uploads = 10'000;      // blobs that a client has begun to send and not finished
  int64_t upload_bytes = int64_t{1} << 40;  // that these will have
  double silence_s = 120;                   // a transfer of which nothing moved for so long is broken off
};

// Refuses with RESOURCE_EXHAUSTED, Refusal::kLimit: the limit, the flag that sets it, and when to try again.
// Thread-safe.
class ClientLimits {
 public:
  using Clock = std::chrono::steady_clock;

  // `blobs` must outlive this.
  ClientLimits(const ClientLimitOptions& options, const BlobStore* blobs) : options_(options), blobs_(blobs) {}

  // Something that counts until it is destroyed. It must not outlive its ClientLimits.
  class Ticket {
   public:
    Ticket() = default;
    Ticket(Ticket&& other) noexcept { *this = std::move(other); }
    Ticket& operator=(Ticket&& other) noexcept;
    ~Ticket() { Return(); }
    // Of a transfer: something moved.
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
  // `break_off` is called, from any thread, if it falls silent; never once the ticket was returned. It must be quick.
  // Empty: it may be silent, as one that reads a scene.
  StatusOr<Ticket> Transfer(const std::string& client, std::function<void()> break_off);
  // Transfers that are under way.
  int transfers() const;
  // To be called about once a second.
  void BreakOffSilent(Clock::time_point now);

  // A client begins an upload, or goes on with one that anybody began. Of earlier processes nothing is known.
  Status BeginUpload(const std::string& client, const Digest& digest);
  // The upload is a blob, or was dropped.
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
  void ForgetSweptLocked(const std::string& client, Clock::time_point now);

  const ClientLimitOptions options_;
  const BlobStore* const blobs_;
  mutable std::mutex mutex_;
  std::list<Ticket::Entry> tickets_;
  std::map<std::string, int> watches_, transfers_;  // by client, none of 0
  int all_transfers_ = 0;
  std::map<std::string, Upload> uploads_;             // by SHA-256
  std::map<std::string, Uploads> uploads_of_client_;  // none of 0
  Clock::time_point swept_at_ = {};
};

}  // namespace tessera

#endif  // TESSERA_SERVER_AUTH_CLIENT_LIMITS_H_

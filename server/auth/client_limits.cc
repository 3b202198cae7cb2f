#include "server/auth/client_limits.h"

#include <vector>

#include "common/base/refusal.h"

namespace tessera {
namespace {

constexpr double kRetryWatch_s = 10, kRetryTransfer_s = 1, kRetryUpload_s = 30;
constexpr std::chrono::seconds kBetweenSweeps{10};  // a sweep checks all uploads of a client

std::string OfClient(const std::string& what, const std::string& client) { return what + " of '" + client + "'"; }

void CountDown(std::map<std::string, int>& counts, const std::string& client) {
  const auto counted = counts.find(client);
  if (--counted->second == 0) counts.erase(counted);
}

}  // namespace

ClientLimits::Ticket& ClientLimits::Ticket::operator=(Ticket&& other) noexcept {
  Return();
  limits_ = std::exchange(other.limits_, nullptr);
  entry_ = other.entry_;
  return *this;
}

void ClientLimits::Ticket::Moved() {
  if (limits_ == nullptr) return;
  std::lock_guard lock(limits_->mutex_);
  entry_->moved = Clock::now();
}

void ClientLimits::Ticket::Return() {
  ClientLimits* const limits = std::exchange(limits_, nullptr);
  if (limits == nullptr) return;
  std::lock_guard lock(limits->mutex_);
  CountDown(entry_->is_watch ? limits->watches_ : limits->transfers_, entry_->client);
  if (!entry_->is_watch) --limits->all_transfers_;
  limits->tickets_.erase(entry_);
}

StatusOr<ClientLimits::Ticket> ClientLimits::Watch(const std::string& client) {
  std::lock_guard lock(mutex_);
  const auto counted = watches_.find(client);
  if ((counted == watches_.end() ? 0 : counted->second) >= options_.watches) {
    return RetryAfter(LimitError({OfClient("watches", client), options_.watches, "--max-watches"}, "end some watches"),
                      kRetryWatch_s);
  }
  ++watches_[client];
  return Ticket(this, tickets_.insert(tickets_.end(), {client, true, {}, {}}));
}

StatusOr<ClientLimits::Ticket> ClientLimits::Transfer(const std::string& client, std::function<void()> break_off) {
  std::lock_guard lock(mutex_);
  const auto counted = transfers_.find(client);
  if ((counted == transfers_.end() ? 0 : counted->second) >= options_.transfers) {
    return RetryAfter(LimitError({OfClient("transfers at once", client), options_.transfers, "--max-transfers"},
                                 "wait until others end"),
                      kRetryTransfer_s);
  }
  if (all_transfers_ >= options_.all_transfers) {
    return RetryAfter(
        LimitError({"transfers at once of all clients", options_.all_transfers, "--max-all-transfers"}, "retry later"),
        kRetryTransfer_s);
  }
  ++transfers_[client];
  ++all_transfers_;
  return Ticket(this, tickets_.insert(tickets_.end(), {client, false, std::move(break_off), Clock::now()}));
}

int ClientLimits::transfers() const {
  std::lock_guard lock(mutex_);
  return all_transfers_;
}

void ClientLimits::BreakOffSilent(Clock::time_point now) {
  std::lock_guard lock(mutex_);
  for (Ticket::Entry& entry : tickets_) {
    if (!entry.break_off || std::chrono::duration<double>(now - entry.moved).count() <= options_.silence_s) continue;
    entry.break_off();
    entry.break_off = {};
  }
}

Status ClientLimits::BeginUpload(const std::string& client, const Digest& digest) {
  std::unique_lock lock(mutex_);
  if (uploads_.contains(digest.sha256)) return absl::OkStatus();
  const auto full = [&]() -> Status {
    const auto found = uploads_of_client_.find(client);
    const Uploads has = found == uploads_of_client_.end() ? Uploads() : found->second;
    if (has.count >= options_.uploads) {
      return LimitError({OfClient("unfinished uploads", client), options_.uploads, "--max-uploads"},
                        "finish some uploads");
    }
    if (digest.size_bytes > options_.upload_bytes - has.bytes) {
      return LimitError({OfClient("bytes of unfinished uploads", client), options_.upload_bytes, "--max-upload-gib"},
                        "finish some uploads");
    }
    return absl::OkStatus();
  };
  if (!full().ok()) ForgetSwept(client, Clock::now(), lock);
  if (uploads_.contains(digest.sha256)) return absl::OkStatus();  // begun meanwhile
  if (const Status status = full(); !status.ok()) return RetryAfter(status, kRetryUpload_s);
  uploads_[digest.sha256] = {client, digest.size_bytes};
  Uploads& has = uploads_of_client_[client];
  ++has.count;
  has.bytes += digest.size_bytes;
  return absl::OkStatus();
}

void ClientLimits::EndUpload(const Digest& digest) {
  std::lock_guard lock(mutex_);
  const auto upload = uploads_.find(digest.sha256);
  if (upload != uploads_.end()) EndUploadLocked(upload);
}

void ClientLimits::EndUploadLocked(std::map<std::string, Upload>::iterator upload) {
  const auto has = uploads_of_client_.find(upload->second.client);
  has->second.bytes -= upload->second.bytes;
  if (--has->second.count == 0) uploads_of_client_.erase(has);
  uploads_.erase(upload);
}

// The blob store removes abandoned uploads after a while without a notification: find those and stop counting them.
void ClientLimits::ForgetSwept(const std::string& client, Clock::time_point now, std::unique_lock<std::mutex>& lock) {
  if (now < swept_at_ + kBetweenSweeps) return;
  swept_at_ = now;
  std::vector<Digest> uploads;
  for (const auto& [sha256, upload] : uploads_) {
    if (upload.client == client) uploads.push_back({sha256, upload.bytes});
  }
  lock.unlock();
  std::erase_if(uploads, [&](const Digest& digest) { return blobs_->CommittedBytes(digest).value_or(1) > 0; });
  lock.lock();
  for (const Digest& digest : uploads) {
    if (const auto upload = uploads_.find(digest.sha256); upload != uploads_.end()) EndUploadLocked(upload);
  }
}

}  // namespace tessera

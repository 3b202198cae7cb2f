#include "common/rpc/direct_transfers.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr int kMaxDigests = 1000;   // of a call
constexpr double kAskSeconds = 60;  // the coordinator may wait 20 s for a blob that is recomputed
constexpr std::chrono::seconds kNoStoreAgain{60};
constexpr size_t kAppendBytes = 1 << 20;
constexpr int64_t kReportBytes = 1 << 20;

void SetDigestOf(v1::Digest* message, const Digest& digest) {
  message->set_sha256(digest.sha256);
  message->set_size_bytes(digest.size_bytes);
}

SignedRequest FromMessage(const v1::SignedRequest& message) {
  return {message.method(), message.url(), {message.headers().begin(), message.headers().end()}};
}

double ShareOf(int64_t offset, const Digest& digest) {
  return digest.size_bytes > 0 ? static_cast<double>(offset) / static_cast<double>(digest.size_bytes) : 1;
}

// Reports an upload, and ends it if it is cancelled. `control` must outlive the result.
std::function<Status(int64_t)> ProgressOf(const Digest& digest, const TaskControl& control, int64_t offset) {
  return [&control, digest, offset, reported = int64_t{-kReportBytes}](int64_t sent_bytes) mutable -> Status {
    if (std::abs(sent_bytes - reported) < kReportBytes) return absl::OkStatus();
    reported = sent_bytes;
    control.Report(ShareOf(offset + sent_bytes, digest), "");
    return control.Check();
  };
}

// The URL without its signature.
std::string_view PlaceOf(std::string_view url) { return url.substr(0, url.find('?')); }

// What a retry of the same request cannot change, but time or a person can.
Status AsOutage(const Status& status) {
  return absl::UnavailableError(absl::StrCat("the object store: ", std::string(status.message())));
}

}  // namespace

DirectTransfers::DirectTransfers(v1::Blobs::Stub* stub, const S3ClientOptions& options)
    : stub_(stub), transfers_(options) {}

StatusOr<v1::GetTransfersResponse> DirectTransfers::Ask(const v1::GetTransfersRequest& request) {
  v1::GetTransfersResponse response;
  if (Steady::now().time_since_epoch().count() >= ask_again_at_) {
    grpc::ClientContext context;
    SetDeadline(context, kAskSeconds);
    const Status status = FromGrpc(stub_->GetTransfers(&context, request, &response));
    if (!status.ok() && !absl::IsUnimplemented(status)) return status;  // an older coordinator has no such call
    if (response.valid_s() <= 0) ask_again_at_ = (Steady::now() + kNoStoreAgain).time_since_epoch().count();
  }
  while (response.transfers_size() < request.digests_size()) response.add_transfers();
  return response;
}

void DirectTransfers::Prepare(const std::vector<Digest>& digests) {
  for (size_t first = 0; first < digests.size(); first += kMaxDigests) {
    v1::GetTransfersRequest request;
    const size_t end = std::min(first + kMaxDigests, digests.size());
    for (size_t i = first; i < end; ++i) SetDigestOf(request.add_digests(), digests[i]);
    const auto asked_at = Steady::now();
    const auto response = Ask(request);
    if (!response.ok()) return;
    const auto until =
        asked_at + std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(response->valid_s() / 2));
    std::lock_guard lock(mutex_);
    std::erase_if(prepared_, [&](const auto& entry) { return entry.second.until < asked_at; });
    for (size_t i = first; i < end; ++i) {
      const v1::Transfer& transfer = response->transfers(static_cast<int>(i - first));
      if (transfer.requests_size() == 1) {
        prepared_[digests[i].sha256] = {FromMessage(transfer.requests(0)), until};
      }
    }
  }
}

StatusOr<std::optional<SignedRequest>> DirectTransfers::RequestFor(const Digest& digest, bool check) {
  {
    std::lock_guard lock(mutex_);
    const auto prepared = prepared_.find(digest.sha256);
    if (prepared != prepared_.end()) {
      Prepared entry = std::move(prepared->second);
      prepared_.erase(prepared);
      if (!check && Steady::now() < entry.until) return std::optional(std::move(entry.request));
    }
  }
  v1::GetTransfersRequest request;
  SetDigestOf(request.add_digests(), digest);
  request.set_check(check);
  TESSERA_ASSIGN_OR_RETURN(const v1::GetTransfersResponse response, Ask(request));
  if (response.transfers(0).requests().empty()) return std::optional<SignedRequest>();
  return std::optional(FromMessage(response.transfers(0).requests(0)));
}

Status DirectTransfers::FetchRest(const Digest& digest, BlobStore& store, const TaskControl& control,
                                  const SignedRequest& request) {
  TESSERA_ASSIGN_OR_RETURN(int64_t offset, store.CommittedBytes(digest));
  std::string buffer;
  const auto append = [&]() -> Status {
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(offset, store.Append(digest, offset, buffer));
    buffer.clear();
    control.Report(ShareOf(offset, digest), "");
    return absl::OkStatus();
  };
  if (offset < digest.size_bytes) {
    Status received = transfers_.Get(request, offset, [&](std::string_view bytes) -> Status {
      if (offset + static_cast<int64_t>(buffer.size() + bytes.size()) > digest.size_bytes) {
        return absl::DataLossError(
            absl::StrCat("the store sent more than the ", digest.size_bytes, " bytes of blob ", digest.sha256));
      }
      buffer.append(bytes);
      return buffer.size() >= kAppendBytes ? append() : absl::OkStatus();
    });
    if (!buffer.empty() && (received.ok() || absl::IsUnavailable(received))) {
      const Status kept = append();
      if (received.ok()) received = kept;
    }
    TESSERA_RETURN_IF_ERROR(received);
    if (offset < digest.size_bytes) {
      return absl::DataLossError(
          absl::StrCat("blob ", digest.sha256, ": the store has only ", offset, " of ", digest.size_bytes, " bytes"));
    }
  }
  return store.Complete(digest);
}

std::optional<Status> DirectTransfers::Fetch(const Digest& digest, BlobStore& store, const TaskControl& control) {
  const auto committed = [&] { return store.CommittedBytes(digest).value_or(0); };
  std::optional<SignedRequest> checked_request;
  for (bool denied = false;;) {
    const auto request =
        checked_request ? StatusOr<std::optional<SignedRequest>>(checked_request) : RequestFor(digest, false);
    if (!request.ok()) return request.status();
    if (!request->has_value()) return std::nullopt;
    const int64_t before = committed();
    const Status status = FetchRest(digest, store, control, **request);
    if (status.ok() || IsFileError(status)) return status;
    switch (status.code()) {
      case absl::StatusCode::kPermissionDenied:  // probably expired: ask again, once unless bytes have arrived
        if (denied && committed() <= before) return AsOutage(status);
        denied = true;
        continue;
      case absl::StatusCode::kNotFound:
      case absl::StatusCode::kDataLoss:
      case absl::StatusCode::kInvalidArgument: {  // the object is shorter than the offset
        const auto checked = RequestFor(digest, true);
        if (!checked.ok()) return checked.status();
        // The same file of another scene.
        if (!checked_request && *checked && PlaceOf((*checked)->url) != PlaceOf((*request)->url)) {
          checked_request = *checked;
          continue;
        }
        if (absl::IsDataLoss(status)) return status;
        return AsOutage(status);
      }
      case absl::StatusCode::kFailedPrecondition:
        return AsOutage(status);
      default:
        return status;
    }
  }
}

Status DirectTransfers::SendParts(const std::string& path, const Digest& digest, const TaskControl& control,
                                  int64_t part_bytes) {
  v1::GetTransfersRequest request;
  SetDigestOf(request.add_digests(), digest);
  request.set_write(true);
  for (int64_t offset = 0; offset < digest.size_bytes; offset += part_bytes) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    Sha256Hasher hasher;
    const int64_t end = std::min(offset + part_bytes, digest.size_bytes);
    for (int64_t at = offset; at < end;) {
      TESSERA_ASSIGN_OR_RETURN(const std::string bytes,
                               ReadFileRange(path, at, std::min<int64_t>(kAppendBytes, end - at)));
      if (bytes.empty()) return absl::FailedPreconditionError(path + ": the file was truncated during its upload");
      hasher.Update(bytes);
      at += static_cast<int64_t>(bytes.size());
    }
    request.add_part_sha256(hasher.Finish());
  }
  v1::CompleteTransferRequest complete;
  *complete.mutable_digest() = request.digests(0);
  v1::Transfer transfer;
  for (int64_t offset = 0, part = 0, denied = 0; offset < digest.size_bytes;) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    if (transfer.requests().empty()) {
      TESSERA_ASSIGN_OR_RETURN(const v1::GetTransfersResponse response, Ask(request));
      transfer = response.transfers(0);
      if (transfer.stored()) return absl::OkStatus();
      if (transfer.requests_size() != request.part_sha256_size()) {
        return absl::UnavailableError("the coordinator signs no more parts of this upload");
      }
      request.set_upload(transfer.upload());
    }
    const int64_t size = std::min(part_bytes, digest.size_bytes - offset);
    const auto etag = transfers_.Put(FromMessage(transfer.requests(static_cast<int>(part))), path, offset, size,
                                     ProgressOf(digest, control, offset));
    if (absl::IsPermissionDenied(etag.status()) && ++denied < 2) {  // expired
      transfer.clear_requests();
      continue;
    }
    TESSERA_RETURN_IF_ERROR(etag.status());
    complete.add_etags(*etag);
    denied = 0;
    ++part;
    offset += size;
  }
  complete.set_upload(request.upload());
  grpc::ClientContext context;
  SetDeadline(context, kAskSeconds);
  v1::CompleteTransferResponse done;
  return FromGrpc(stub_->CompleteTransfer(&context, complete, &done));
}

std::optional<Status> DirectTransfers::Send(const std::string& path, const Digest& digest, const TaskControl& control) {
  v1::GetTransfersRequest request;
  SetDigestOf(request.add_digests(), digest);
  request.set_write(true);
  for (bool denied = false;; denied = true) {
    if (const Status wanted = control.Check(); !wanted.ok()) return wanted;
    const auto response = Ask(request);
    if (!response.ok()) return response.status();
    const v1::Transfer& transfer = response->transfers(0);
    if (transfer.stored()) return absl::OkStatus();
    if (transfer.requests().empty() && transfer.part_bytes() <= 0) return std::nullopt;
    const Status status = transfer.part_bytes() > 0 ? SendParts(path, digest, control, transfer.part_bytes())
                                                    : transfers_
                                                          .Put(FromMessage(transfer.requests(0)), path, 0,
                                                               digest.size_bytes, ProgressOf(digest, control, 0))
                                                          .status();
    if (absl::IsPermissionDenied(status) && !denied) continue;  // probably expired
    if (status.code() == absl::StatusCode::kPermissionDenied || absl::IsNotFound(status)) return AsOutage(status);
    return status;
  }
}

}  // namespace tessera

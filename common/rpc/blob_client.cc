#include "common/rpc/blob_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>

#include "common/rpc/channel.h"
#include "common/rpc/direct_transfers.h"
#include "common/rpc/status_conversion.h"
#include "common/storage/files.h"
#include "tessera/v1/blobs.grpc.pb.h"

namespace tessera {
namespace {

// Time allowed for a chunk. The deadline of a stream is the sum over its chunks plus kCallSeconds.
constexpr double kSecondsPerChunk = 2.0;
constexpr double kCallSeconds = 30.0;

double StreamSeconds(int64_t bytes) {
  return kCallSeconds + kSecondsPerChunk * static_cast<double>(bytes / kBlobChunkBytes + 1);
}

void SetDigest(const Digest& digest, v1::Digest* message) {
  message->set_sha256(digest.sha256);
  message->set_size_bytes(digest.size_bytes);
}

double Share(int64_t offset, const Digest& digest) {
  return digest.size_bytes > 0 ? static_cast<double>(offset) / static_cast<double>(digest.size_bytes) : 1;
}

// Transfers damaged in transit are retried this often; more failures mean that the network or a disk is faulty.
constexpr int kMaxDamaged = 3;

// The store's requests are repeated a few times with the same URL; then the coordinator is asked again.
constexpr int kAttemptsOfUrl = 3;

S3ClientOptions StoreOptions(const RetryPolicy& retry, const Sleeper& sleeper, const std::string& ca_file) {
  S3ClientOptions options;
  options.retry = retry;
  options.retry.max_attempts = kAttemptsOfUrl;
  options.sleeper = sleeper;
  options.ca_file = ca_file;
  return options;
}

}  // namespace

struct BlobClient::Impl {
  std::unique_ptr<v1::Blobs::Stub> stub;
  RetryPolicy retry;
  Sleeper sleeper;
  DirectTransfers direct;

  Impl(std::unique_ptr<v1::Blobs::Stub> of, const RetryPolicy& policy, Sleeper waits, const std::string& ca_file)
      : stub(std::move(of)),
        retry(policy),
        sleeper(std::move(waits)),
        direct(stub.get(), StoreOptions(retry, sleeper, ca_file)) {}

  // Calls `attempt` until it succeeds, fails permanently, or fails retry.max_attempts times without progress.
  // `committed` returns the bytes transferred so far. Reports why it waits.
  Status RetryWithProgress(const Digest& digest, const TaskControl& control, const std::function<Status()>& attempt,
                           const std::function<int64_t()>& committed) const {
    Backoff backoff(retry);
    int failures = 0;
    int damaged = 0;
    int64_t before = committed();
    while (true) {
      const Status status = attempt();
      if (status.ok()) return status;
      if (status.code() == absl::StatusCode::kDataLoss) {
        if (++damaged >= kMaxDamaged) return status;
      } else if (!IsTransient(status, Idempotency::kIdempotent)) {
        return status;
      }
      const int64_t now = committed();
      if (now > before) {
        failures = 0;
        backoff.Reset();
      }
      before = now;
      if (retry.max_attempts > 0 && ++failures >= retry.max_attempts) return status;
      control.Report(Share(now, digest), std::string(status.message()));
      if (!sleeper(backoff.NextDelay(status))) return absl::CancelledError("transfer cancelled");
    }
  }
};

BlobClient::BlobClient(std::shared_ptr<grpc::Channel> channel, const RetryPolicy& retry, Sleeper sleeper,
                       const std::string& ca_file)
    : impl_(std::make_shared<Impl>(v1::Blobs::NewStub(std::move(channel)), retry, std::move(sleeper), ca_file)) {}

void BlobClient::Prepare(const std::vector<Digest>& digests) { impl_->direct.Prepare(digests); }

Status BlobClient::FetchOnce(const Digest& digest, BlobStore& store, const TaskControl& control) {
  if (const auto fetched = impl_->direct.Fetch(digest, store, control)) return *fetched;
  TESSERA_ASSIGN_OR_RETURN(int64_t offset, store.CommittedBytes(digest));
  if (offset < digest.size_bytes) {
    grpc::ClientContext context;
    SetDeadline(context, StreamSeconds(digest.size_bytes - offset));
    v1::ReadBlobRequest request;
    SetDigest(digest, request.mutable_digest());
    request.set_offset(offset);
    const auto reader = impl_->stub->ReadBlob(&context, request);
    // Cancels the stream and returns `status` instead of the stream's own status.
    const auto stop = [&](Status status) {
      context.TryCancel();
      v1::BlobChunk rest;
      while (reader->Read(&rest)) {
      }
      reader->Finish();
      return status;
    };
    v1::BlobChunk chunk;
    while (reader->Read(&chunk)) {
      if (const Status wanted = control.Check(); !wanted.ok()) return stop(wanted);
      if (chunk.offset() != offset || Xxh3(chunk.data()) != chunk.xxh3()) {
        return stop(absl::DataLossError("chunk at byte " + std::to_string(offset) + " of blob " + digest.sha256 +
                                        " was damaged in transit: its checksum differs"));
      }
      const auto committed = store.Append(digest, offset, chunk.data());
      if (!committed.ok()) return stop(committed.status());
      offset = *committed;
      control.Report(Share(offset, digest), "");
    }
    TESSERA_RETURN_IF_ERROR(FromGrpc(reader->Finish()));
    if (offset < digest.size_bytes) {
      return absl::UnavailableError("blob " + digest.sha256 + ": received " + std::to_string(offset) + " of " +
                                    std::to_string(digest.size_bytes) + " bytes");
    }
  }
  return store.Complete(digest);
}

Status BlobClient::Fetch(const Digest& digest, BlobStore& store, const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  if (store.Has(digest)) return absl::OkStatus();
  const auto fetch = [&]() -> Status {
    TESSERA_RETURN_IF_ERROR(control.Check());
    return FetchOnce(digest, store, control);
  };
  return impl_->RetryWithProgress(digest, control, fetch, [&] { return store.CommittedBytes(digest).value_or(0); });
}

Status BlobClient::SendOnce(const std::string& path, const Digest& digest, const TaskControl& control,
                            int64_t* committed) {
  if (const auto sent = impl_->direct.Send(path, digest, control)) return *sent;
  v1::QueryWriteResponse state;
  {
    grpc::ClientContext context;
    SetDeadline(context, kCallSeconds);
    v1::QueryWriteRequest request;
    SetDigest(digest, request.mutable_digest());
    TESSERA_RETURN_IF_ERROR(FromGrpc(impl_->stub->QueryWrite(&context, request, &state)));
  }
  if (state.complete()) return absl::OkStatus();
  int64_t offset = std::clamp<int64_t>(state.committed_bytes(), 0, digest.size_bytes);
  *committed = offset;
  grpc::ClientContext context;
  SetDeadline(context, StreamSeconds(digest.size_bytes - offset));
  v1::WriteBlobResponse response;
  const auto writer = impl_->stub->WriteBlob(&context, &response);
  Status own = absl::OkStatus();
  bool first = true;
  while (first || offset < digest.size_bytes) {
    own = control.Check();
    if (!own.ok()) break;
    const auto bytes = ReadFileRange(path, offset, std::min(kBlobChunkBytes, digest.size_bytes - offset));
    if (!bytes.ok()) {
      own = bytes.status();
      break;
    }
    if (bytes->empty() && digest.size_bytes > offset) {
      own = absl::FailedPreconditionError(path + ": the file was truncated during its upload");
      break;
    }
    v1::WriteBlobRequest request;
    if (first) SetDigest(digest, request.mutable_digest());
    first = false;
    request.mutable_chunk()->set_offset(offset);
    request.mutable_chunk()->set_xxh3(Xxh3(*bytes));
    offset += static_cast<int64_t>(bytes->size());
    control.Report(Share(offset, digest), "");
    *request.mutable_chunk()->mutable_data() = *bytes;
    if (!writer->Write(request)) break;  // Finish returns the reason
  }
  if (!own.ok()) {
    context.TryCancel();
    writer->Finish();
    return own;
  }
  writer->WritesDone();
  TESSERA_RETURN_IF_ERROR(FromGrpc(writer->Finish()));
  if (response.committed_bytes() < digest.size_bytes) {
    return absl::UnavailableError(path + ": the coordinator stored " + std::to_string(response.committed_bytes()) +
                                  " of " + std::to_string(digest.size_bytes) + " bytes");
  }
  return absl::OkStatus();
}

Status BlobClient::Send(const std::string& path, const Digest& digest, const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  int64_t committed = 0;  // as last reported by the coordinator
  return impl_->RetryWithProgress(
      digest, control, [&] { return SendOnce(path, digest, control, &committed); }, [&] { return committed; });
}

}  // namespace tessera

#include <algorithm>
#include <chrono>
#include <memory>
#include <thread>

#include "common/rpc/status_conversion.h"
#include "common/storage/files.h"
#include "server/admission/scene_files.h"
#include "server/grpc/conversion.h"
#include "server/grpc/services.h"

namespace tessera {
namespace {

constexpr int64_t kChunkBytes = int64_t{1} << 20;
constexpr double kAwaitRemakeS = 20;  // longest wait of a ReadBlob call
constexpr int kMaxDigests = 1000;     // per StatBlobs call
constexpr size_t kMaxWorkersKept = 10'000;
constexpr char kNotYours[] =
    "permission denied: workers may read the inputs of their leases, other callers published results";

// An error of the coordinator's disk may be transient: report it as RESOURCE_EXHAUSTED, so that callers retry.
Status StorageStatus(const Status& status) {
  if (!IsFileError(status)) return status;
  return absl::ResourceExhaustedError("the coordinator cannot store the blob: " + std::string(status.message()));
}

}  // namespace

bool BlobsService::IsInput(const std::string& worker, const Digest& digest) const {
  auto leases = leases_.LeasesOf(worker);
  std::lock_guard lock(mutex_);
  if (leases.empty()) {
    inputs_.erase(worker);
    return false;
  }
  if (inputs_.size() > kMaxWorkersKept) inputs_.clear();
  Inputs& inputs = inputs_[worker];
  if (inputs.leases != leases) inputs = {std::move(leases), leases_.InputsOfLeases(worker)};
  return inputs.sha256.contains(digest.sha256);
}

Status BlobsService::MayRead(const Caller& caller, const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  if (!caller.worker.empty() && IsInput(caller.worker, digest)) return absl::OkStatus();
  if (caller.Has(Role::kAdmin)) return absl::OkStatus();
  const bool reads_jobs = caller.Has(Role::kViewer) || caller.Has(Role::kSubmitter);
  if (reads_jobs && jobs_.IsPublished(digest)) return absl::OkStatus();
  return absl::PermissionDeniedError(kNotYours);
}

Status BlobsService::MayWrite(const Caller& caller) const {
  if (!caller.worker.empty() && !leases_.LeasesOf(caller.worker).empty()) return absl::OkStatus();
  return absl::PermissionDeniedError("permission denied: only a worker with a lease may store blobs");
}

StatusOr<BlobsService::Source> BlobsService::LocateInStore(const std::string& url, const Digest& digest) const {
  if (environment_.stored_scenes == nullptr) {
    return absl::FailedPreconditionError(url + " cannot be read: tesserad has no --scene-root with it");
  }
  TESSERA_ASSIGN_OR_RETURN(const StoredScenes::Place place, environment_.stored_scenes->Find(url));
  TESSERA_ASSIGN_OR_RETURN(const S3Object object, place.client->Head(place.key));
  if (object.size_bytes != digest.size_bytes) {
    return absl::FailedPreconditionError(url + " was changed after its job was submitted");
  }
  return Source{url, [place](int64_t offset_bytes, int64_t size_bytes) {
                  return place.client->Get(place.key, offset_bytes, size_bytes);
                }};
}

StatusOr<BlobsService::Source> BlobsService::Locate(const Caller& caller, const Digest& digest) const {
  const Status stored = environment_.blobs->Stat(digest);
  if (stored.ok()) {
    return Source{"blob " + digest.sha256, [this, digest](int64_t offset_bytes, int64_t size_bytes) {
                    return environment_.blobs->ReadRange(digest, offset_bytes, size_bytes);
                  }};
  }
  if (!absl::IsNotFound(stored)) return stored;
  Status fault = absl::NotFoundError("no blob " + digest.sha256);
  if (caller.worker.empty() || !IsInput(caller.worker, digest)) return fault;
  // Several jobs may have scene files of this content, some of which may be removed or changed.
  for (const std::string& path : jobs_.SceneFilesWith(digest)) {
    if (IsS3Url(path)) {
      auto stored_file = LocateInStore(path, digest);
      if (stored_file.ok()) return stored_file;
      if (absl::IsNotFound(fault)) fault = stored_file.status();
      continue;
    }
    auto file = environment_.scene_files.Open(path);
    const auto found =
        file.ok() ? DigestOfFile(*file, *environment_.digests, *environment_.clock) : StatusOr<Digest>(file.status());
    if (found.ok() && *found == digest) {
      const auto held = std::make_shared<AllowedFile>(*std::move(file));
      return Source{held->real_path(),
                    [held](int64_t offset_bytes, int64_t size_bytes) { return held->Read(offset_bytes, size_bytes); }};
    }
    if (absl::IsNotFound(fault)) {
      fault = found.ok() ? absl::FailedPreconditionError(path + " was changed after its job was submitted")
                         : found.status();
    }
  }
  return fault;
}

Status BlobsService::AwaitRemake(const Digest& digest, const grpc::ServerContext& context) const {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(kAwaitRemakeS);
  while (true) {
    TESSERA_RETURN_IF_ERROR(recovery_.RemakeArtifact(digest));
    if (environment_.blobs->Has(digest)) return absl::OkStatus();
    if (context.IsCancelled() || core_.stopped() || std::chrono::steady_clock::now() > until) {
      return absl::UnavailableError("blob " + digest.sha256 + " was lost and is being recomputed; try again later");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
}

Status BlobsService::Damaged(const Digest& digest, const std::string& what) const {
  // Published files are recomputed. Workers report lost inputs themselves.
  recovery_.RemakeArtifact(digest).IgnoreError();
  return absl::DataLossError(what);
}

grpc::Status BlobsService::StatBlobs(grpc::ServerContext* context, const v1::StatBlobsRequest* request,
                                     v1::StatBlobsResponse* response) {
  if (request->digests_size() > kMaxDigests) {
    return ToGrpc(InputError("digests", "", std::to_string(request->digests_size()),
                             "at most " + std::to_string(kMaxDigests) + " in a call"));
  }
  const Caller caller = environment_.access->CallerOf(*context);
  std::vector<Digest> readable;
  std::vector<int> place;  // of each in the answer
  for (const auto& message : request->digests()) {
    const Digest digest = FromProto(message);
    if (MayRead(caller, digest).ok()) {
      readable.push_back(digest);
      place.push_back(response->stored_size());
    }
    response->add_stored(false);
  }
  const std::vector<Status> found = StatMany(*environment_.blobs, readable);
  for (size_t i = 0; i < readable.size(); ++i) {
    // A scene file has no blob.
    const bool stored = found[i].ok() || (absl::IsNotFound(found[i]) && Locate(caller, readable[i]).ok());
    response->set_stored(place[i], stored);
  }
  return grpc::Status::OK;
}

grpc::Status BlobsService::ReadBlob(grpc::ServerContext* context, const v1::ReadBlobRequest* request,
                                    grpc::ServerWriter<v1::BlobChunk>* writer) {
  const Digest digest = FromProto(request->digest());
  const Caller caller = environment_.access->CallerOf(*context);
  if (const Status allowed = MayRead(caller, digest); !allowed.ok()) return ToGrpc(allowed);
  auto ticket = limits_.Transfer(caller.mover(), [context] { context->TryCancel(); });
  if (!ticket.ok()) return ToGrpc(ticket.status());
  auto source = Locate(caller, digest);
  if (absl::IsNotFound(source.status())) {
    if (const Status made = AwaitRemake(digest, *context); !made.ok()) return ToGrpc(made);
    source = Locate(caller, digest);
  }
  if (!source.ok()) return ToGrpc(source.status());
  if (request->offset() < 0 || request->offset() > digest.size_bytes) {
    return ToGrpc(absl::InvalidArgumentError("offset: found " + std::to_string(request->offset()) + ", expected 0 to " +
                                             std::to_string(digest.size_bytes) + " bytes"));
  }
  // Hash streams from the start, to distinguish stored damage from damage in transit.
  Sha256Hasher hasher;
  int64_t offset = request->offset();
  while (offset < digest.size_bytes && !context->IsCancelled()) {
    const auto bytes = source->read(offset, std::min(kChunkBytes, digest.size_bytes - offset));
    if (absl::IsNotFound(bytes.status())) return ToGrpc(Damaged(digest, source->name + " was deleted"));
    if (!bytes.ok()) return ToGrpc(bytes.status());
    if (bytes->empty()) return ToGrpc(Damaged(digest, source->name + " was truncated"));
    hasher.Update(*bytes);
    const bool last = offset + static_cast<int64_t>(bytes->size()) == digest.size_bytes;
    if (last && request->offset() == 0 && hasher.Finish() != digest.sha256) {
      return ToGrpc(Damaged(digest, source->name + " is damaged: it no longer hashes to " + digest.sha256));
    }
    v1::BlobChunk chunk;
    chunk.set_offset(offset);
    chunk.set_xxh3(Xxh3(*bytes));
    offset += static_cast<int64_t>(bytes->size());
    *chunk.mutable_data() = *bytes;
    if (!writer->Write(chunk)) break;
    ticket->Moved();
  }
  return grpc::Status::OK;
}

grpc::Status BlobsService::WriteBlob(grpc::ServerContext* context, grpc::ServerReader<v1::WriteBlobRequest>* reader,
                                     v1::WriteBlobResponse* response) {
  const Caller caller = environment_.access->CallerOf(*context);
  if (const Status allowed = MayWrite(caller); !allowed.ok()) return ToGrpc(allowed);
  auto ticket = limits_.Transfer(caller.mover(), [context] { context->TryCancel(); });
  if (!ticket.ok()) return ToGrpc(ticket.status());
  v1::WriteBlobRequest request;
  Digest digest;
  bool first = true;
  while (reader->Read(&request)) {
    ticket->Moved();
    if (first) {
      digest = FromProto(request.digest());
      if (const Status status = CheckDigest(digest); !status.ok()) return ToGrpc(status);
      if (const Status status = limits_.BeginUpload(caller.client, digest); !status.ok()) return ToGrpc(status);
      first = false;
    }
    const v1::BlobChunk& chunk = request.chunk();
    if (Xxh3(chunk.data()) != chunk.xxh3()) {
      return ToGrpc(absl::DataLossError("the chunk at " + std::to_string(chunk.offset()) + " was damaged in transit"));
    }
    const auto committed = environment_.blobs->Append(digest, chunk.offset(), chunk.data());
    if (!committed.ok()) return ToGrpc(StorageStatus(committed.status()));
    response->set_committed_bytes(*committed);
  }
  if (first) return ToGrpc(absl::InvalidArgumentError("upload: found no message, expected a digest and bytes"));
  // After an interrupted stream, the writer resumes at committed_bytes.
  if (response->committed_bytes() < digest.size_bytes) return grpc::Status::OK;
  const Status complete = environment_.blobs->Complete(digest);
  if (complete.ok() || absl::IsDataLoss(complete)) limits_.EndUpload(digest);
  return ToGrpc(StorageStatus(complete));
}

grpc::Status BlobsService::QueryWrite(grpc::ServerContext* context, const v1::QueryWriteRequest* request,
                                      v1::QueryWriteResponse* response) {
  if (const Status allowed = MayWrite(environment_.access->CallerOf(*context)); !allowed.ok()) return ToGrpc(allowed);
  const Digest digest = FromProto(request->digest());
  const auto committed = environment_.blobs->CommittedBytes(digest);
  if (!committed.ok()) return ToGrpc(committed.status());
  response->set_committed_bytes(*committed);
  response->set_complete(environment_.blobs->Has(digest));
  return grpc::Status::OK;
}

}  // namespace tessera

// Signed URLs for blobs in an object store.
#include "absl/strings/str_cat.h"
#include "common/rpc/status_conversion.h"
#include "server/grpc/conversion.h"
#include "server/grpc/services.h"

namespace tessera {
namespace {

constexpr int kMaxTransfers = 1000;            // digests of a call, and parts of a content
constexpr double kSceneTransferValid_s = 900;  // of the URL of a scene file, without an object store for blobs

// An error of the store that the caller did not cause is an outage: the caller waits and tries again.
Status AsCallersStatus(const Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kResourceExhausted:
      return status;
    default:
      return absl::UnavailableError(absl::StrCat("the object store: ", std::string(status.message())));
  }
}

void SetRequest(const SignedRequest& request, v1::SignedRequest* message) {
  message->set_method(request.method);
  message->set_url(request.url);
  message->mutable_headers()->insert(request.headers.begin(), request.headers.end());
}

}  // namespace

Status BlobsService::CheckStored(const Caller& caller, const Digest& digest, grpc::ServerContext& context) {
  TESSERA_ASSIGN_OR_RETURN(const auto ticket, limits_.Transfer(caller.mover(), {}));
  const Status stored = environment_.blobs->VerifyOrQuarantine(digest);
  if (absl::IsNotFound(stored) || absl::IsDataLoss(stored)) return AwaitRemake(digest, context);
  return AsCallersStatus(stored);
}

std::vector<std::string> BlobsService::StoredSceneFiles(const Caller& caller, const Digest& digest) const {
  if (environment_.stored_scenes == nullptr || caller.worker.empty() || !IsInput(caller.worker, digest)) return {};
  std::vector<std::string> urls = jobs_.SceneFilesWith(digest);
  std::erase_if(urls, [&](const std::string& path) {
    return !IsS3Url(path) ||
           !environment_.stored_scenes->Find(path).ok();  // of a base job, perhaps, whose root is gone
  });
  return urls;
}

StatusOr<v1::Transfer> BlobsService::TransferOfSceneFile(const Caller& caller, const Digest& digest,
                                                         const std::vector<std::string>& urls, bool check) const {
  const StoredScenes& scenes = *environment_.stored_scenes;
  Status fault;
  for (const std::string& url : urls) {
    if (check) {
      TESSERA_ASSIGN_OR_RETURN(const auto ticket, limits_.Transfer(caller.mover(), {}));
      const auto found = scenes.Hash(url);
      if (!found.ok() && !absl::IsNotFound(found.status())) return found.status();
      if (!found.ok() || !(*found == digest)) {
        if (fault.ok()) fault = absl::NotFoundError(absl::StrCat(url, " was changed after its job was submitted"));
        continue;
      }
    }
    TESSERA_ASSIGN_OR_RETURN(const StoredScenes::Place place, scenes.Find(url));
    TESSERA_ASSIGN_OR_RETURN(
        const SignedRequest signed_request,
        place.client->SignGet(
            place.key, environment_.transfers == nullptr ? kSceneTransferValid_s : environment_.transfers->valid_s()));
    v1::Transfer transfer;
    SetRequest(signed_request, transfer.add_requests());
    return transfer;
  }
  return fault;
}

StatusOr<v1::Transfer> BlobsService::TransferOf(const Caller& caller, const Digest& digest,
                                                const v1::GetTransfersRequest& request) const {
  v1::Transfer transfer;
  if (!request.write()) {
    const std::vector<std::string> urls = StoredSceneFiles(caller, digest);
    if (!urls.empty()) return TransferOfSceneFile(caller, digest, urls, request.check());
  }
  if (environment_.transfers == nullptr) return transfer;
  const BlobTransfers& transfers = *environment_.transfers;
  if (request.write()) {
    if (!transfers.takes_uploads()) return transfer;
    TESSERA_ASSIGN_OR_RETURN(
        const BlobUpload upload,
        transfers.Write(digest, {request.part_sha256().begin(), request.part_sha256().end()}, request.upload()));
    transfer.set_stored(upload.stored);
    transfer.set_part_bytes(upload.part_bytes);
    transfer.set_upload(upload.id);
    for (const SignedRequest& signed_request : upload.requests) SetRequest(signed_request, transfer.add_requests());
    return transfer;
  }
  // The blob service reads files of scenes in folders. Asking the store for each would take long: a scene has
  // thousands.
  if (!jobs_.SceneFilesWith(digest).empty()) return transfer;
  TESSERA_ASSIGN_OR_RETURN(const SignedRequest signed_request, transfers.Read(digest));
  SetRequest(signed_request, transfer.add_requests());
  return transfer;
}

grpc::Status BlobsService::GetTransfers(grpc::ServerContext* context, const v1::GetTransfersRequest* request,
                                        v1::GetTransfersResponse* response) {
  const bool about_one = request->check() || request->part_sha256_size() > 0;
  if (request->digests_size() > (about_one ? 1 : kMaxTransfers) || request->part_sha256_size() > kMaxTransfers) {
    return ToGrpc(InputError("digests", "",
                             absl::StrCat(request->digests_size(), " with ", request->part_sha256_size(), " parts"),
                             absl::StrCat("at most ", kMaxTransfers, ", or one with as many parts or to be checked")));
  }
  const Caller caller = environment_.access->CallerOf(*context);
  for (const v1::Digest& message : request->digests()) {
    const Digest digest = FromProto(message);
    const Status allowed = request->write() ? MayWrite(caller) : MayRead(caller, digest);
    if (!allowed.ok()) return ToGrpc(allowed);
    if (const Status status = CheckDigest(digest); !status.ok()) return ToGrpc(status);
  }
  if (environment_.transfers == nullptr && environment_.stored_scenes == nullptr) {
    for (int i = 0; i < request->digests_size(); ++i) response->add_transfers();
    return grpc::Status::OK;
  }
  response->set_valid_s(environment_.transfers == nullptr ? kSceneTransferValid_s : environment_.transfers->valid_s());
  for (const v1::Digest& message : request->digests()) {
    const Digest digest = FromProto(message);
    if (request->check() && !request->write() && StoredSceneFiles(caller, digest).empty()) {
      if (const Status stored = CheckStored(caller, digest, *context); !stored.ok()) return ToGrpc(stored);
    }
    StatusOr<v1::Transfer> transfer = TransferOf(caller, digest, *request);
    if (!transfer.ok()) return ToGrpc(AsCallersStatus(transfer.status()));
    *response->add_transfers() = *std::move(transfer);
  }
  return grpc::Status::OK;
}

grpc::Status BlobsService::CompleteTransfer(grpc::ServerContext* context, const v1::CompleteTransferRequest* request,
                                            v1::CompleteTransferResponse*) {
  if (const Status allowed = MayWrite(environment_.access->CallerOf(*context)); !allowed.ok()) return ToGrpc(allowed);
  if (environment_.transfers == nullptr) {
    return ToGrpc(absl::FailedPreconditionError("found an upload in parts, but the coordinator has no object store"));
  }
  if (request->etags_size() > kMaxTransfers) {
    return ToGrpc(
        InputError("etags", "", absl::StrCat(request->etags_size()), absl::StrCat("at most ", kMaxTransfers)));
  }
  return ToGrpc(AsCallersStatus(environment_.transfers->Complete(FromProto(request->digest()), request->upload(),
                                                                 {request->etags().begin(), request->etags().end()})));
}

}  // namespace tessera

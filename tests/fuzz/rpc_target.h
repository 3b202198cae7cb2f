// Calls of a coordinator's services, one per frame: the method and the bytes of its request.
#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/version.h"
#include "common/log/log.h"
#include "common/rpc/channel.h"
#include "server/grpc/coordinator_server.h"
#include "tessera/v1/blobs.pb.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/promises.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {

inline constexpr int kMethodsOfService = 32;
inline constexpr int kCallKinds = 3 * kMethodsOfService + 1;
inline constexpr uint8_t kTimePasses = 3 * kMethodsOfService;  // no call: its first byte in minutes

// The method that a frame of this kind calls: 0 to 31 are those of Jobs in their order, 32 on of Workers, 64 on of
// Blobs. Null if there is none.
inline const google::protobuf::MethodDescriptor* MethodOfKind(uint8_t kind) {
  const google::protobuf::FileDescriptor* const files[] = {v1::CreateJobRequest::descriptor()->file(),
                                                           v1::RegisterWorkerRequest::descriptor()->file(),
                                                           v1::ReadBlobRequest::descriptor()->file()};
  if (kind >= kTimePasses) return nullptr;
  const google::protobuf::ServiceDescriptor& service = *files[kind / kMethodsOfService]->service(0);
  const int method = kind % kMethodsOfService;
  return method < service.method_count() ? service.method(method) : nullptr;
}

// A coordinator with a job of two tiles, of which a worker runs the first task, behind a socket.
class FuzzedCoordinator {
 public:
  FuzzedCoordinator() {
    Require(SetUpLog("off", false).ok(), "there is a log");
    const std::string scene = folder_.path() + "/scene";
    Require(EnsureFolder(scene).ok() && WriteFileAtomic(scene + "/scene.json", "{}").ok(), "there is a scene");
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &planner_, &clock_, /*on_change=*/{}}, {});
    environment_.coordinator = coordinator_.get();
    environment_.blobs = blobs_.get();
    environment_.digests = &digests_;
    environment_.clock = &clock_;
    environment_.scene_files = *AllowedFiles::Under({folder_.path()});
    environment_.read_scene = [](const std::string& path, const SceneRequest&,
                                 const AllowedFiles& allowed) -> StatusOr<SceneListing> {
      TESSERA_ASSIGN_OR_RETURN(auto files, allowed.List(path));
      SceneListing listing{path, "fake", files, {}};
      listing.scene.up_in_local.setZero();
      return listing;
    };
    server_ = *CoordinatorServer::Start("unix:" + folder_.path() + "/socket", environment_);
    const auto identity = std::make_shared<CallIdentity>();
    channel_ = MakeChannel(server_->address(), identity);
    v1::CreateJobRequest job;
    job.set_scene_path(scene);
    job.mutable_settings()->set_tiles(2);
    Call("/tessera.v1.Jobs/CreateJob", {job.SerializeAsString()}, {});
    v1::RegisterWorkerRequest request;
    request.set_version(kAlgorithmVersion);
    v1::RegisterWorkerResponse worker;
    Require(
        worker.ParseFromString(Call("/tessera.v1.Workers/RegisterWorker", {request.SerializeAsString()}, {}).second),
        "a worker registers");
    identity->SetWorker(worker.worker(), worker.secret());
    v1::LeaseTaskRequest lease;
    lease.set_worker(worker.worker());
    Call("/tessera.v1.Workers/LeaseTask", {lease.SerializeAsString()}, std::chrono::seconds(1));
  }
  ~FuzzedCoordinator() { server_->Shutdown(0); }

  // Sends the messages, reads some of the answers, and gives how it ended, with the last answer. Without a time to
  // wait, until it ends.
  std::pair<grpc::Status, std::string> Call(const std::string& method, const std::vector<std::string>& messages,
                                            std::chrono::milliseconds wait) {
    grpc::GenericStub stub(channel_);
    grpc::ClientContext context;
    if (wait.count() > 0) context.set_deadline(std::chrono::system_clock::now() + wait);
    grpc::CompletionQueue queue;
    const auto done = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    const auto call = stub.PrepareCall(&context, method, &queue);
    call->StartCall(nullptr);
    bool ok = done();
    for (size_t i = 0; ok && i < messages.size(); ++i) {
      const grpc::Slice slice(messages[i]);
      call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
      ok = done();
    }
    if (ok) {
      call->WritesDone(nullptr);
      done();
    }
    std::string answer;
    for (int i = 0; i < 8; ++i) {
      grpc::ByteBuffer received;
      call->Read(&received, nullptr);
      if (!done()) break;
      grpc::Slice whole;
      Require(received.DumpToSingleSlice(&whole).ok(), "an answer has bytes");
      answer.assign(reinterpret_cast<const char*>(whole.begin()), whole.size());
    }
    grpc::Status status;
    call->Finish(&status, nullptr);
    done();
    return {status, answer};
  }

  void Advance(double seconds) {
    clock_.Advance(seconds);
    coordinator_->Tick().IgnoreError();
  }
  // What a coordinator that starts anew makes of all that was stored.
  void Replay() {
    server_->Shutdown(0);
    coordinator_.reset();
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &planner_, &clock_, /*on_change=*/{}}, {});
    Require(store_.quarantined.empty(), "what was stored can be used");
  }

 private:
  struct NoDigests : DigestCache {
    std::optional<Digest> Find(const std::string&, const FileStamp&) override { return std::nullopt; }
    Status Remember(const std::string&, const FileStamp&, const Digest&) override { return absl::OkStatus(); }
  };
  TempFolder folder_ = *TempFolder::Create("");
  std::unique_ptr<FolderBlobs> blobs_ = *FolderBlobs::Open(folder_.path() + "/blobs");
  MemoryStore store_;
  FakePlanner planner_;
  FakeClock clock_;
  NoDigests digests_;
  std::unique_ptr<Coordinator> coordinator_;
  ServerEnvironment environment_;
  std::unique_ptr<CoordinatorServer> server_;
  std::shared_ptr<grpc::Channel> channel_;
};

// True if all calls were answered with OK, or wait.
inline bool RunRpcTarget(const std::string& bytes) {
  FuzzedCoordinator coordinator;
  bool all_ok = true;
  int calls = 0;
  const std::vector<InputFrame> frames = SplitFrames(bytes);
  for (size_t i = 0; i < frames.size(); ++i) {
    const InputFrame& frame = frames[i];
    if (frame.kind == kTimePasses) coordinator.Advance(frame.bytes.empty() ? 1 : 60.0 * frame.bytes[0]);
    const google::protobuf::MethodDescriptor* const method = MethodOfKind(frame.kind);
    if (method == nullptr || ++calls > 20) continue;
    const std::string path = "/" + method->service()->full_name() + "/" + method->name();
    // Those that may wait for something to happen.
    const bool waits = method->server_streaming() || method->name() == "LeaseTask";
    std::vector<std::string> messages = {frame.bytes};
    // Those that follow go into the same stream.
    while (method->client_streaming() && i + 1 < frames.size() && frames[i + 1].kind == frame.kind) {
      messages.push_back(frames[++i].bytes);
    }
    const auto [status, answer] = coordinator.Call(path, messages, std::chrono::milliseconds(waits ? 100 : 0));
    const bool waited = waits && status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
    all_ok = all_ok && (status.ok() || waited);
    const std::unique_ptr<google::protobuf::Message> request(
        google::protobuf::MessageFactory::generated_factory()->GetPrototype(method->input_type())->New());
    const auto parses = [&](const std::string& message) { return request->ParseFromString(message); };
    if (!std::all_of(messages.begin(), messages.end(), parses)) continue;
    Require(status.error_code() != grpc::StatusCode::UNKNOWN && status.error_code() != grpc::StatusCode::INTERNAL,
            "what is wrong with a request has its own code");
    Require(answer.size() < 4 << 20, "answers are below gRPC's usual limit");
  }
  coordinator.Replay();
  return all_ok;
}

}  // namespace tessera

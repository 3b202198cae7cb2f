// A coordinator's gRPC server on loopback with the fake planner.
#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>

#include "common/base/version.h"
#include "common/log/log.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/channel.h"
#include "server/grpc/coordinator_server.h"
#include "server/store/sqlite_store.h"
#include "tessera/v1/blobs.grpc.pb.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {

// Any folder with a scene.json is a scene.
class ServerTest : public CoordinatorTest {
 protected:
  ServerTest() {
    EXPECT_TRUE(SetUpLog("off", false).ok());
    scene_ = folder_.path() + "/scene";
    EXPECT_TRUE(EnsureFolder(scene_).ok());
    WriteScene("scene.json", "{}");
    WriteScene("image", std::string(2'500'000, 'i') + "end");
    cache_ = *SqliteStore::Open(folder_.path() + "/cache.sqlite");
    environment_.coordinator = coordinator_.get();
    environment_.blobs = blobs_.get();
    environment_.digests = cache_.get();
    environment_.clock = &clock_;
    environment_.read_scene = [](const std::string& path, const SceneRequest&,
                                 const AllowedFiles&) -> StatusOr<SceneListing> {
      if (!FileExists(path + "/scene.json")) {
        return absl::InvalidArgumentError("scene.json: missing\nimages: missing");
      }
      TESSERA_ASSIGN_OR_RETURN(auto files, ListFiles(path));
      return SceneListing{path, "fake", files, {"an odd thing"}};
    };
    environment_.shared_blob_dir = blobs_->root();
    environment_.shared_probe_path = "/probe";
    environment_.shared_probe_content = "content";
    Start();
  }
  ~ServerTest() override {
    if (server_ != nullptr) server_->Shutdown(1);
  }

  void Start() {
    server_ = *CoordinatorServer::Start("127.0.0.1:0", environment_);
    channel_ = MakeChannel(server_->address());
    jobs_ = v1::Jobs::NewStub(channel_);
    workers_ = v1::Workers::NewStub(channel_);
    blob_service_ = v1::Blobs::NewStub(channel_);
  }

  // Starts the coordinator and its server again, with the present environment_.
  void RestartServer() {
    server_->Shutdown(1);
    Restart();
    environment_.coordinator = coordinator_.get();
    Start();
  }

  // The file's change time is long before the fake clock's time.
  void WriteScene(const std::string& name, const std::string& content, int age_hours = 1) {
    const std::string path = scene_ + "/" + name;
    std::ofstream(path, std::ios::binary) << content;
    const auto now = std::chrono::file_clock::from_sys(
        std::chrono::sys_time<std::chrono::microseconds>(std::chrono::microseconds(clock_.UnixTimeUs())));
    std::filesystem::last_write_time(path, now - std::chrono::hours(age_hours));
  }

  grpc::Status CreateJob(v1::Job* job, const std::string& request_id = "", bool validate_only = false,
                         const std::string& path = "") {
    grpc::ClientContext context;
    v1::CreateJobRequest request;
    request.set_request_id(request_id);
    request.set_validate_only(validate_only);
    request.set_scene_path(path.empty() ? scene_ : path);
    request.mutable_settings()->set_tiles(2);
    return jobs_->CreateJob(&context, request, job);
  }
  v1::RegisterWorkerResponse Register() {
    grpc::ClientContext context;
    v1::RegisterWorkerRequest request;
    request.set_version(kAlgorithmVersion);
    v1::RegisterWorkerResponse response;
    EXPECT_TRUE(workers_->RegisterWorker(&context, request, &response).ok());
    secrets_[response.worker()] = response.secret();
    return response;
  }
  // Makes the call as the worker.
  void As(grpc::ClientContext& context, const std::string& worker) {
    context.AddMetadata(kWorkerMetadata, worker);
    context.AddMetadata(kWorkerSecretMetadata, secrets_[worker]);
  }
  v1::LeaseTaskResponse LeaseOverRpc(const std::string& worker) {
    grpc::ClientContext context;
    As(context, worker);
    v1::LeaseTaskRequest request;
    request.set_worker(worker);
    request.set_wait_s(20);  // planning is faster
    v1::LeaseTaskResponse response;
    EXPECT_TRUE(workers_->LeaseTask(&context, request, &response).ok());
    return response;
  }
  static Digest DigestOf(const std::string& content) {
    return {Sha256Hex(content), static_cast<int64_t>(content.size())};
  }
  // A channel whose calls are made as the worker.
  std::shared_ptr<grpc::Channel> ChannelOf(const std::string& worker) {
    const auto identity = std::make_shared<CallIdentity>();
    identity->SetWorker(worker, secrets_[worker]);
    return MakeChannel(server_->address(), identity);
  }
  // `worker`: makes the call as this worker; empty: without a worker.
  Status Fetch(const Digest& digest, BlobStore& store, const std::string& worker = "") {
    RetryPolicy once;
    once.max_attempts = 1;
    return BlobClient(worker.empty() ? channel_ : ChannelOf(worker), once, [](double) { return true; })
        .Fetch(digest, store, {});
  }

  std::map<std::string, std::string> secrets_;  // by worker
  std::string scene_;
  std::unique_ptr<SqliteStore> cache_;
  ServerEnvironment environment_;
  std::unique_ptr<CoordinatorServer> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::Jobs::Stub> jobs_;
  std::unique_ptr<v1::Workers::Stub> workers_;
  std::unique_ptr<v1::Blobs::Stub> blob_service_;
};

}  // namespace tessera

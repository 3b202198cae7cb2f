// Calls are answered while the blob store, or reading a scene, takes long: no thread that answers calls waits for it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <future>
#include <mutex>
#include <thread>
#include <vector>

#include "common/rpc/status_conversion.h"
#include "server/auth/client_limits.h"
#include "tests/support/watched_blobs.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

constexpr int kCalls = 12;  // gRPC has fewer threads for callbacks

// Digests of scene files that are not found before the test says so.
class LateDigests final : public DigestCache {
 public:
  std::optional<Digest> Find(const std::string&, const FileStamp&) override {
    std::unique_lock lock(mutex_);
    ++waiting_;
    changed_.notify_all();
    changed_.wait(lock, [&] { return released_; });
    return std::nullopt;
  }
  Status Remember(const std::string&, const FileStamp&, const Digest&) override { return absl::OkStatus(); }
  bool AwaitWaiting(int calls) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(20), [&] { return waiting_ >= calls; });
  }
  void Release() {
    std::lock_guard lock(mutex_);
    released_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int waiting_ = 0;
  bool released_ = false;
};

class LateStoreTest : public ServerTest {
 protected:
  LateStoreTest() {
    environment_.blobs = &watched_;
    StartAgain();
  }
  ~LateStoreTest() override {
    digests_.Release();
    watched_.Release();
    server_->Shutdown(1);
    server_.reset();
    coordinator_.reset();
  }

  // With the present environment_, and a new coordinator: the end of a server stops its coordinator.
  void StartAgain() {
    server_->Shutdown(1);
    server_.reset();
    coordinator_ = *Coordinator::Open({&store_, &watched_, &planner_, &clock_, {}}, options_);
    environment_.coordinator = coordinator_.get();
    Start();
  }

  Status Beat(const std::string& worker) {
    grpc::ClientContext context;
    As(context, worker);
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    v1::HeartbeatRequest request;
    request.set_worker(worker);
    v1::HeartbeatResponse response;
    return FromGrpc(workers_->Heartbeat(&context, request, &response));
  }
  Status Report(const std::string& worker, const v1::Lease& lease) {
    grpc::ClientContext context;
    As(context, worker);
    v1::ReportTaskRequest request;
    request.set_worker(worker);
    request.set_task(lease.spec().task());
    request.set_attempt(lease.attempt());
    const auto add = [&](const std::string& name) {
      const std::string content = name + " of " + lease.spec().task();
      v1::OutputFile& output = *request.mutable_success()->add_outputs();
      output.set_name(name);
      const Digest digest = *blobs_->PutBytes(content);
      output.mutable_digest()->set_sha256(digest.sha256);
      output.mutable_digest()->set_size_bytes(digest.size_bytes);
    };
    if (lease.spec().kind() == "ingest") {
      add("survey.json");
      add("mesh");
    } else {
      add("refined");
    }
    v1::ReportTaskResponse response;
    return FromGrpc(workers_->ReportTask(&context, request, &response));
  }

  WatchedBlobs watched_{blobs_.get()};
  LateDigests digests_;
};

TEST_F(LateStoreTest, ReportsAreAnsweredWhileNoStoreCallReturns) {
  NewJob job = AJob(kCalls);
  job.scene_path = scene_;
  ASSERT_TRUE(coordinator_->jobs().CreateJob(job).ok());
  std::vector<std::string> workers;
  for (int i = 0; i < kCalls; ++i) workers.push_back(Register().worker());
  ASSERT_TRUE(Report(workers[0], LeaseOverRpc(workers[0]).lease()).ok());
  std::vector<v1::Lease> leases;
  for (const std::string& worker : workers) leases.push_back(LeaseOverRpc(worker).lease());
  watched_.Hold();
  std::vector<std::future<Status>> reports;
  for (int i = 0; i < kCalls; ++i) {
    reports.push_back(std::async(std::launch::async, [&, i] { return Report(workers[i], leases[i]); }));
  }
  EXPECT_TRUE(Beat(workers[0]).ok());
  for (std::future<Status>& report : reports) {
    const bool answered = report.wait_for(std::chrono::seconds(20)) == std::future_status::ready;
    EXPECT_TRUE(answered) << "a report waits for the blob store";
    if (!answered) watched_.Release();
    EXPECT_TRUE(report.get().ok());
  }
}

TEST_F(LateStoreTest, CallsAreAnsweredWhileScenesAreRead) {
  environment_.digests = &digests_;
  StartAgain();
  const std::string worker = Register().worker();
  std::vector<std::future<bool>> created;
  for (int i = 0; i < kCalls; ++i) {
    created.push_back(std::async(std::launch::async, [&] {
      v1::Job job;
      return CreateJob(&job).ok();
    }));
  }
  EXPECT_TRUE(digests_.AwaitWaiting(kCalls));
  EXPECT_TRUE(Beat(worker).ok());
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
  v1::ListJobsResponse jobs;
  EXPECT_TRUE(jobs_->ListJobs(&context, {}, &jobs).ok());
  EXPECT_EQ(jobs.jobs_size(), 0);
  digests_.Release();
  for (std::future<bool>& each : created) EXPECT_TRUE(each.get());
}

// The blob store is asked for abandoned uploads when a client has too many; others watch and transfer meanwhile.
TEST_F(LateStoreTest, LimitsDoNotWaitForTheStore) {
  ClientLimitOptions few;
  few.uploads = 1;
  ClientLimits limits(few, &watched_);
  const Digest digests[] = {{std::string(64, 'a'), 5}, {std::string(64, 'b'), 5}};
  ASSERT_TRUE(limits.BeginUpload("client", digests[0]).ok());
  watched_.Hold();
  auto second = std::async(std::launch::async, [&] { return limits.BeginUpload("client", digests[1]); });
  ASSERT_TRUE(watched_.AwaitHeld(1));
  auto other = std::async(std::launch::async, [&] { return limits.Watch("other").ok(); });
  EXPECT_EQ(other.wait_for(std::chrono::seconds(20)), std::future_status::ready);
  watched_.Release();
  EXPECT_TRUE(other.get());
  EXPECT_TRUE(second.get().ok()) << "the first upload has no bytes, so it does not count";
}

}  // namespace
}  // namespace tessera

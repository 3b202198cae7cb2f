// Draining of coordinator and workers, and watches across a restart.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "common/base/version.h"
#include "common/rpc/channel.h"
#include "common/storage/hash.h"
#include "tessera/v1/blobs.grpc.pb.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/e2e/leased_worker.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

using testing::HasSubstr;

class DrainTest : public testing::Test {
 protected:
  // An upload that is under way to the coordinator, by a worker that has a lease.
  struct Upload {
    explicit Upload(Cluster& cluster) {
      const auto channel = ConnectLeasedWorker(cluster.address());
      EXPECT_TRUE(channel.ok()) << channel.status();
      if (!channel.ok()) return;
      blobs = v1::Blobs::NewStub(*channel);
      writer = blobs->WriteBlob(&context, &response);
      v1::WriteBlobRequest chunk;
      chunk.mutable_digest()->set_sha256(Sha256Hex("content"));
      chunk.mutable_digest()->set_size_bytes(7);
      chunk.mutable_chunk()->set_data("cont");
      chunk.mutable_chunk()->set_xxh3(Xxh3("cont"));
      EXPECT_TRUE(writer->Write(chunk));
      const std::string partial = cluster.data() + "/blobs/partial/" + Sha256Hex("content");
      EXPECT_TRUE(WaitUntil([&] { return FileExists(partial); }));
    }
    std::unique_ptr<v1::Blobs::Stub> blobs;
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    std::unique_ptr<grpc::ClientWriter<v1::WriteBlobRequest>> writer;
  };

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(DrainTest, DrainingCoordinatorWaitsForCalls) {
  Cluster cluster(folder_.path(), 3, {"--drain-s", "600"});
  cluster.Submit(ToyCity(), 2);
  Upload upload(cluster);
  cluster.coordinator().Signal(SIGTERM);
  EXPECT_TRUE(WaitUntil([&] { return cluster.coordinator().Output().find("drains") != std::string::npos; }));
  v1::CreateJobRequest request;
  request.set_scene_path(ToyCity());
  grpc::ClientContext context;
  v1::Job job;
  const auto jobs = v1::Jobs::NewStub(MakeChannel(cluster.address()));
  EXPECT_EQ(jobs->CreateJob(&context, request, &job).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_TRUE(cluster.coordinator().Running());
  v1::WriteBlobRequest rest;
  rest.mutable_chunk()->set_offset(4);
  rest.mutable_chunk()->set_data("ent");
  rest.mutable_chunk()->set_xxh3(Xxh3("ent"));
  EXPECT_TRUE(upload.writer->Write(rest));
  EXPECT_TRUE(upload.writer->WritesDone());
  EXPECT_TRUE(upload.writer->Finish().ok());
  EXPECT_EQ(cluster.coordinator().Wait().exit_code, 0);
}

TEST_F(DrainTest, SecondSignalStopsCoordinatorImmediately) {
  Cluster cluster(folder_.path(), 3, {"--drain-s", "600"});
  cluster.Submit(ToyCity(), 2);
  Upload upload(cluster);
  cluster.coordinator().Signal(SIGTERM);
  EXPECT_TRUE(WaitUntil([&] { return cluster.coordinator().Output().find("drains") != std::string::npos; }));
  cluster.coordinator().Signal(SIGTERM);
  EXPECT_EQ(cluster.coordinator().Wait().exit_code, 128 + SIGTERM);
  cluster.StartCoordinator();
  v1::Job job;
  EXPECT_TRUE(cluster.connection().GetJob("jobs/1", &job).ok()) << "what was acknowledged is there";
}

TEST_F(DrainTest, DrainingWorkerFinishesItsTask) {
  Cluster cluster(folder_.path());
  const v1::Job job = cluster.Submit(ToyCity(), 4);
  Program& worker = cluster.AddWorker({"--drain-s", "600"});
  const auto told = [&](const std::string& what) {
    const std::string output = worker.Output();
    int count = 0;
    for (size_t at = output.find(what); at != std::string::npos; at = output.find(what, at + 1)) ++count;
    return count;
  };
  ASSERT_TRUE(WaitUntil([&] { return told(" info started ") > 0; }));
  worker.Signal(SIGTERM);
  EXPECT_EQ(worker.Wait().exit_code, 0);
  EXPECT_EQ(told(" info succeeded "), told(" info started ")) << worker.Output();
  for (const v1::Task& task : cluster.Tasks(job.name())) EXPECT_NE(task.state(), v1::TASK_STATE_LEASED);
}

// Slurm signals all processes of a job, and the job's script passes the signal on.
TEST_F(DrainTest, RepeatedSignalDoesNotStopADrainingWorker) {
  Cluster cluster(folder_.path());
  cluster.Submit(ToyCity(), 4);
  Program& worker = cluster.AddWorker({"--drain-s", "600"});
  const auto told = [&](const std::string& what) { return worker.Output().find(what) != std::string::npos; };
  ASSERT_TRUE(WaitUntil([&] { return told(" info started "); }));
  worker.Signal(SIGTERM);
  ASSERT_TRUE(WaitUntil([&] { return told("draining"); }));
  worker.Signal(SIGTERM);
  EXPECT_EQ(worker.Wait().exit_code, 0) << worker.Output();
}

// Every state is sent once, including the final one, although the coordinator was killed and restarted.
TEST_F(DrainTest, WatchResumesAfterCoordinatorRestart) {
  Cluster cluster(folder_.path());
  const v1::Job job = cluster.Submit(ToyCity(), 2);
  Program watch(folder_.path(), TESSERA_PROGRAM, {"watch", job.name(), "--json", "--coordinator", cluster.address()});
  const auto shows = [&](const std::string& text) {
    return WaitUntil([&] { return watch.Output().find(text) != std::string::npos; });
  };
  ASSERT_TRUE(shows("etag"));
  cluster.coordinator().Kill();
  cluster.StartCoordinator();
  v1::ChangeJobRequest change;
  change.set_name(job.name());
  change.set_priority(42);
  v1::Job changed;
  ASSERT_TRUE(cluster.connection().ChangeJob(change, &changed).ok());
  ASSERT_TRUE(shows("\"priority\":42"));
  ASSERT_TRUE(cluster.connection().CancelJob(job.name(), &changed).ok());
  const Outcome outcome = watch.Wait();
  EXPECT_EQ(outcome.exit_code, 130) << outcome.output;
  std::istringstream lines(outcome.output);
  std::string last_etag, last_state;
  for (std::string line; std::getline(lines, line);) {
    const auto update = nlohmann::json::parse(line, nullptr, false);
    if (!update.is_object()) continue;
    EXPECT_NE(update["etag"], last_etag) << line;
    last_etag = update["etag"];
    last_state = update["job"]["state"];
  }
  EXPECT_EQ(last_state, "JOB_STATE_CANCELLED");
}

}  // namespace
}  // namespace tessera::e2e

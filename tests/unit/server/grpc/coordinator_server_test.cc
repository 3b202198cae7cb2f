#include "server/grpc/coordinator_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <latch>
#include <set>
#include <thread>

#include "common/base/refusal.h"
#include "common/rpc/status_conversion.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST_F(ServerTest, CreateJobValidatesAndIsIdempotent) {
  v1::Job job, again;
  ASSERT_TRUE(CreateJob(&job, "r", /*validate_only=*/true).ok());
  EXPECT_EQ(job.name(), "");
  EXPECT_THAT(job.warnings(), ElementsAre("an odd thing"));
  EXPECT_TRUE(coordinator_->jobs().ListJobs(-1, 10).empty());
  ASSERT_TRUE(CreateJob(&job, "r").ok());
  EXPECT_EQ(job.name(), "jobs/1");
  EXPECT_EQ(job.display_name(), "fake");
  EXPECT_EQ(job.state(), v1::JOB_STATE_QUEUED);
  ASSERT_TRUE(CreateJob(&again, "r").ok());
  EXPECT_EQ(again.name(), "jobs/1");
  ASSERT_TRUE(CreateJob(&again, "r", false, scene_ + "/./").ok()) << "the same path";
  EXPECT_EQ(again.name(), "jobs/1");
  const grpc::Status other = CreateJob(&again, "r", false, "/none");
  EXPECT_EQ(other.error_code(), grpc::StatusCode::ALREADY_EXISTS);
  EXPECT_THAT(other.error_message(), HasSubstr("scene_path: found /none, expected " + scene_));

  const grpc::Status bad = CreateJob(&job, "", false, "/none");
  EXPECT_EQ(bad.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(bad.error_message(), "scene.json: missing\nimages: missing");
  EXPECT_EQ(CreateJob(&job, "", false, "relative").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  grpc::ClientContext context;
  v1::CreateJobRequest request;
  request.set_scene_path(scene_);
  request.mutable_settings()->set_tiles(-1);
  EXPECT_EQ(jobs_->CreateJob(&context, request, &job).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 10).size(), 1u);
}

TEST_F(ServerTest, ConcurrentRepeatedRequestsGiveOneJob) {
  constexpr int kCalls = 100;
  std::latch together(kCalls);
  std::vector<v1::Job> jobs(kCalls);
  std::vector<grpc::Status> answers(kCalls);
  {
    std::vector<std::jthread> callers;
    for (int i = 0; i < kCalls; ++i) {
      callers.emplace_back([&, i] {
        together.arrive_and_wait();
        answers[i] = CreateJob(&jobs[i], "night");
      });
    }
  }
  for (int i = 0; i < kCalls; ++i) {
    EXPECT_TRUE(answers[i].ok()) << answers[i].error_message();
    EXPECT_EQ(jobs[i].name(), "jobs/1");
  }
  EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 10).size(), 1u);
}

TEST_F(ServerTest, WorkerRunsAJobOverRpc) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const auto registration = Register();
  EXPECT_EQ(registration.shared_blob_dir(), blobs_->root());
  EXPECT_GT(registration.lease_s(), registration.heartbeat_s());
  std::vector<std::string> states;
  std::thread watcher([&] {
    grpc::ClientContext context;
    v1::WatchJobRequest request;
    request.set_name(job.name());
    const auto reader = jobs_->WatchJob(&context, request);
    v1::WatchJobResponse update;
    while (reader->Read(&update)) states.push_back(v1::JobState_Name(update.job().state()));
    EXPECT_TRUE(reader->Finish().ok());
  });
  for (int tasks = 0; tasks < 4; ++tasks) {
    const v1::Lease lease = LeaseOverRpc(registration.worker()).lease();
    ASSERT_EQ(lease.attempt(), 1);
    EXPECT_EQ(lease.spec().key().size(), 64u);
    if (tasks == 0) {
      ASSERT_EQ(lease.spec().inputs_size(), 2);
      EXPECT_EQ(lease.spec().inputs(0).shared_path(), scene_ + "/image");
    }
    grpc::ClientContext heartbeat_context, report_context;
    As(heartbeat_context, registration.worker());
    As(report_context, registration.worker());
    v1::HeartbeatRequest heartbeat;
    heartbeat.set_worker(registration.worker());
    heartbeat.add_tasks()->set_task(lease.spec().task());
    heartbeat.mutable_tasks(0)->set_attempt(1);
    heartbeat.mutable_tasks(0)->set_progress(0.5);
    v1::HeartbeatResponse stop;
    ASSERT_TRUE(workers_->Heartbeat(&heartbeat_context, heartbeat, &stop).ok());
    EXPECT_EQ(stop.stop_tasks_size(), 0);
    GrantedLease granted;
    granted.plan.kind = lease.spec().kind();
    granted.key = lease.spec().key();
    v1::ReportTaskRequest report;
    report.set_worker(registration.worker());
    report.set_task(lease.spec().task());
    report.set_attempt(1);
    for (const NamedDigest& output : Result(granted).outputs) {
      v1::OutputFile& added = *report.mutable_success()->add_outputs();
      added.set_name(output.name);
      added.mutable_digest()->set_sha256(output.digest.sha256);
      added.mutable_digest()->set_size_bytes(output.digest.size_bytes);
    }
    v1::ReportTaskResponse response;
    ASSERT_TRUE(workers_->ReportTask(&report_context, report, &response).ok());
  }
  watcher.join();
  EXPECT_EQ(states.back(), "JOB_STATE_SUCCEEDED");

  grpc::ClientContext first_context, second_context;
  v1::ListTasksRequest request;
  request.set_parent(job.name());
  request.set_page_size(3);
  v1::ListTasksResponse page;
  ASSERT_TRUE(jobs_->ListTasks(&first_context, request, &page).ok());
  EXPECT_EQ(page.tasks_size(), 3);
  EXPECT_EQ(page.tasks(1).title(), "refine tile 0");
  request.set_page_token(page.next_page_token());
  ASSERT_TRUE(jobs_->ListTasks(&second_context, request, &page).ok());
  EXPECT_EQ(page.tasks_size(), 1);
  EXPECT_EQ(page.next_page_token(), "");
}

// One call reports and leases the next task. If its answer is lost, the repeated call, or a lease call with the same
// number, returns the same lease.
TEST_F(ServerTest, ReportAnswerCarriesTheNextLease) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const std::string worker = Register().worker();
  const auto report = [&](const v1::Lease& lease, int64_t lease_call, v1::ReportTaskResponse* response) {
    grpc::ClientContext context;
    As(context, worker);
    v1::ReportTaskRequest request;
    request.set_worker(worker);
    request.set_task(lease.spec().task());
    request.set_attempt(lease.attempt());
    request.set_lease_call(lease_call);
    GrantedLease granted;
    granted.plan.kind = lease.spec().kind();
    granted.key = lease.spec().key();
    for (const NamedDigest& output : Result(granted).outputs) {
      v1::OutputFile& added = *request.mutable_success()->add_outputs();
      added.set_name(output.name);
      added.mutable_digest()->set_sha256(output.digest.sha256);
      added.mutable_digest()->set_size_bytes(output.digest.size_bytes);
    }
    return FromGrpc(workers_->ReportTask(&context, request, response));
  };
  const auto leased_tasks = [&] { return coordinator_->leases().ListWorkers().at(0).tasks; };

  v1::ReportTaskResponse ingested, first, again, stale, none;
  ASSERT_TRUE(report(LeaseOverRpc(worker).lease(), 0, &ingested).ok());
  EXPECT_FALSE(ingested.has_lease()) << "not requested";
  const v1::Lease tile = LeaseOverRpc(worker).lease();
  ASSERT_TRUE(report(tile, 7, &first).ok());
  EXPECT_EQ(std::set({tile.spec().title(), first.lease().spec().title()}),
            std::set<std::string>({"refine tile 0", "refine tile 1"}));
  EXPECT_THAT(leased_tasks(), ElementsAre(first.lease().spec().task()));

  ASSERT_TRUE(report(tile, 7, &again).ok());
  EXPECT_EQ(again.SerializeAsString(), first.SerializeAsString());
  grpc::ClientContext context;
  As(context, worker);
  v1::LeaseTaskRequest request;
  request.set_worker(worker);
  request.set_call(7);
  v1::LeaseTaskResponse leased;
  ASSERT_TRUE(workers_->LeaseTask(&context, request, &leased).ok());
  EXPECT_EQ(leased.lease().SerializeAsString(), first.lease().SerializeAsString());

  v1::Lease late = tile;
  late.set_attempt(9);
  EXPECT_EQ(RefusalOf(report(late, 8, &stale)), Refusal::kNotCurrent);
  EXPECT_FALSE(stale.has_lease());
  EXPECT_THAT(leased_tasks(), ElementsAre(first.lease().spec().task())) << "a refused report gets no lease";

  // The report of the last task before publish is answered at once.
  ASSERT_TRUE(report(first.lease(), 8, &none).ok());
}

TEST_F(ServerTest, ErrorsKeepTheirCodes) {
  grpc::ClientContext job_context, lease_context, version_context, token_context, report_context;
  v1::GetJobRequest get;
  get.set_name("jobs/7");
  v1::Job job;
  EXPECT_EQ(jobs_->GetJob(&job_context, get, &job).error_code(), grpc::StatusCode::NOT_FOUND);
  v1::LeaseTaskRequest lease;
  lease.set_worker(Register().worker());
  As(lease_context, lease.worker());
  EXPECT_TRUE(UnregisterAndWait(*coordinator_, lease.worker()).ok());
  v1::LeaseTaskResponse leased;
  EXPECT_EQ(workers_->LeaseTask(&lease_context, lease, &leased).error_code(), grpc::StatusCode::NOT_FOUND);
  v1::RegisterWorkerRequest registration;
  registration.set_version("another");
  v1::RegisterWorkerResponse registered;
  EXPECT_EQ(workers_->RegisterWorker(&version_context, registration, &registered).error_code(),
            grpc::StatusCode::FAILED_PRECONDITION);
  v1::ListJobsRequest list;
  list.set_page_token("x");
  v1::ListJobsResponse listed;
  EXPECT_EQ(jobs_->ListJobs(&token_context, list, &listed).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  v1::ReportTaskRequest report;
  report.set_worker(lease.worker());
  As(report_context, lease.worker());
  v1::ReportTaskResponse reported;
  EXPECT_EQ(workers_->ReportTask(&report_context, report, &reported).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(CoordinatorServer::Start(server_->address(), environment_).status().code(), absl::StatusCode::kUnavailable);
}

// Workers handle errors by their reason, not by their code.
TEST_F(ServerTest, RefusalsCarryTheirReason) {
  grpc::ClientContext lease_context, version_context, report_context, job_context;
  v1::LeaseTaskRequest lease;
  lease.set_worker(Register().worker());
  As(lease_context, lease.worker());
  EXPECT_TRUE(UnregisterAndWait(*coordinator_, lease.worker()).ok());
  v1::LeaseTaskResponse leased;
  EXPECT_EQ(RefusalOf(FromGrpc(workers_->LeaseTask(&lease_context, lease, &leased))), Refusal::kUnknownWorker);
  v1::RegisterWorkerRequest registration;
  registration.set_version("another");
  v1::RegisterWorkerResponse registered;
  EXPECT_EQ(RefusalOf(FromGrpc(workers_->RegisterWorker(&version_context, registration, &registered))),
            Refusal::kOtherVersion);
  v1::ReportTaskRequest report;
  report.set_worker(lease.worker());
  As(report_context, lease.worker());
  report.set_task("jobs/9/tasks/3");
  report.mutable_failure()->set_message("it broke");
  v1::ReportTaskResponse reported;
  EXPECT_EQ(RefusalOf(FromGrpc(workers_->ReportTask(&report_context, report, &reported))), Refusal::kNotCurrent);
  v1::GetJobRequest get;
  get.set_name("jobs/7");
  v1::Job job;
  EXPECT_EQ(RefusalOf(FromGrpc(jobs_->GetJob(&job_context, get, &job))), Refusal::kNone);
}

TEST_F(ServerTest, WithoutSharedStorageNoPathIsSent) {
  server_->Shutdown(1);
  environment_.shared_probe_path.clear();
  Restart();
  environment_.coordinator = coordinator_.get();
  Start();
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const auto registration = Register();
  EXPECT_EQ(registration.shared_blob_dir(), "");
  EXPECT_EQ(registration.shared_probe_path(), "");
  const v1::Lease lease = LeaseOverRpc(registration.worker()).lease();
  ASSERT_GT(lease.spec().inputs_size(), 0);
  for (const auto& input : lease.spec().inputs()) EXPECT_EQ(input.shared_path(), "");
}

TEST_F(ServerTest, ChangedSceneFilesAreNotServed) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const std::string content = std::string(2'500'000, 'i') + "end";
  const std::string worker = Register().worker();
  ASSERT_TRUE(LeaseOverRpc(worker).has_lease());
  const auto store = *FolderBlobs::Open(folder_.path() + "/worker");
  ASSERT_TRUE(Fetch(DigestOf(content), *store, worker).ok());
  EXPECT_EQ(*store->Read(DigestOf(content)), content);
  EXPECT_EQ(Fetch(DigestOf("nowhere"), *store).code(), absl::StatusCode::kNotFound);

  const auto other = *FolderBlobs::Open(folder_.path() + "/other");
  WriteScene("image", std::string(2'500'000, 'j') + "end", 0);
  const Status changed = Fetch(DigestOf(content), *other, worker);
  EXPECT_EQ(changed.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(changed.message()), HasSubstr("was changed after its job was submitted"));
  // Changed with the same size and modification time: the change time differs.
  WriteScene("image", std::string(2'500'000, 'k') + "end");
  EXPECT_EQ(Fetch(DigestOf(content), *other, worker).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(other->Has(DigestOf(content)));
}

TEST_F(ServerTest, JobReadsItsOwnSceneWhenACopyIsRemoved) {
  const std::string copy = folder_.path() + "/copy", content = std::string(2'500'000, 'i') + "end";
  // Submit the copy after and before the scene itself.
  for (const auto& scenes : {std::vector<std::string>{scene_, copy}, std::vector<std::string>{copy, scene_}}) {
    std::filesystem::copy(scene_, copy, std::filesystem::copy_options::recursive);
    for (const std::string& scene : scenes) {
      v1::Job job;
      ASSERT_TRUE(CreateJob(&job, "", false, scene).ok());
      const Status cancelled = scene == copy ? coordinator_->jobs().CancelJob(job.name()).status() : absl::OkStatus();
      EXPECT_TRUE(cancelled.ok());
    }
    ASSERT_TRUE(RemoveTree(copy).ok());
    ASSERT_TRUE(RemoveTree(folder_.path() + "/worker").ok());
    const auto store = *FolderBlobs::Open(folder_.path() + "/worker");
    const std::string worker = Register().worker();
    ASSERT_TRUE(LeaseOverRpc(worker).has_lease());
    EXPECT_TRUE(Fetch(DigestOf(content), *store, worker).ok());
    // Start each order with an empty ledger.
    server_->Shutdown(1);
    store_.records.clear();
    Restart();
    environment_.coordinator = coordinator_.get();
    Start();
  }
}

TEST_F(ServerTest, BlobsAreUploadedInCheckedChunksWithResume) {
  const std::string content = std::string(1'500'000, 'u') + "end";
  const Digest digest = DigestOf(content);
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const std::string worker = Register().worker();
  ASSERT_TRUE(LeaseOverRpc(worker).has_lease());
  const auto write = [&](const std::vector<std::pair<int64_t, std::string>>& chunks, bool damage) {
    grpc::ClientContext context;
    As(context, worker);
    v1::WriteBlobResponse response;
    const auto writer = blob_service_->WriteBlob(&context, &response);
    v1::WriteBlobRequest request;
    request.mutable_digest()->set_sha256(digest.sha256);
    request.mutable_digest()->set_size_bytes(digest.size_bytes);
    for (const auto& [offset, data] : chunks) {
      request.mutable_chunk()->set_offset(offset);
      request.mutable_chunk()->set_data(data);
      request.mutable_chunk()->set_xxh3(Xxh3(data) + (damage ? 1 : 0));
      if (!writer->Write(request)) break;
      request.clear_digest();
    }
    writer->WritesDone();
    return writer->Finish();
  };
  EXPECT_EQ(write({{0, content.substr(0, 1000)}}, true).error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_EQ(*blobs_->CommittedBytes(digest), 0);
  EXPECT_TRUE(write({{0, content.substr(0, 1000)}}, false).ok());  // interrupted
  EXPECT_FALSE(blobs_->Has(digest));
  EXPECT_EQ(write({{2000, "gap"}}, false).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  std::ofstream(folder_.path() + "/upload", std::ios::binary) << content;
  ASSERT_TRUE(
      BlobClient(ChannelOf(worker), {}, [](double) { return true; }).Send(folder_.path() + "/upload", digest, {}).ok());
  EXPECT_EQ(*blobs_->Read(digest), content);
  EXPECT_EQ(write({}, false).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, ShutdownEndsWaitingCalls) {
  const auto registration = Register();
  clock_.Advance(5);
  std::thread waiter([&] {
    grpc::ClientContext context;
    As(context, registration.worker());
    v1::LeaseTaskRequest request;
    request.set_worker(registration.worker());
    request.set_wait_s(30);
    v1::LeaseTaskResponse response;
    EXPECT_TRUE(workers_->LeaseTask(&context, request, &response).ok());
    EXPECT_FALSE(response.has_lease());
  });
  while (coordinator_->leases().ListWorkers().at(0).last_seen_s > 0)
    std::this_thread::yield();  // until the call has arrived
  server_->Shutdown(20);
  waiter.join();
}

TEST_F(ServerTest, CancelledCallGetsNoLease) {
  const auto registration = Register(), other = Register();
  clock_.Advance(5);
  grpc::ClientContext context;
  As(context, registration.worker());
  std::thread waiter([&] {
    v1::LeaseTaskRequest request;
    request.set_worker(registration.worker());
    request.set_wait_s(30);
    v1::LeaseTaskResponse response;
    EXPECT_EQ(workers_->LeaseTask(&context, request, &response).error_code(), grpc::StatusCode::CANCELLED);
  });
  while (coordinator_->leases().ListWorkers().at(0).last_seen_s > 0)
    std::this_thread::yield();  // until the call has arrived
  context.TryCancel();
  waiter.join();
  for (int i = 0; i < 3; ++i) Register();  // on the same connection: the server has seen the cancellation then
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  EXPECT_EQ(LeaseOverRpc(other.worker()).lease().attempt(), 1);
}

// More waiting calls than threads and than a connection's limit of concurrent calls.
TEST_F(ServerTest, HundredsOfCallsWaitConcurrently) {
  constexpr int kWorkers = 300;
  struct Call {
    grpc::ClientContext context;
    v1::LeaseTaskRequest request;
    v1::LeaseTaskResponse response;
  };
  std::vector<Call> calls(kWorkers);
  std::latch answered(kWorkers);
  const auto other = MakeChannel(server_->address());
  const auto others = v1::Workers::NewStub(other);
  for (int i = 0; i < kWorkers; ++i) {
    calls[i].request.set_worker(Register().worker());
    As(calls[i].context, calls[i].request.worker());
    calls[i].request.set_wait_s(30);
    const auto& stub = i % 2 == 0 ? workers_ : others;
    stub->async()->LeaseTask(&calls[i].context, &calls[i].request, &calls[i].response, [&](const grpc::Status& status) {
      EXPECT_TRUE(status.ok()) << status.error_message();
      answered.count_down();
    });
  }
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  while (coordinator_->jobs().RunningTasks(job.name())->empty()) std::this_thread::yield();
  coordinator_->core().Stop();
  answered.wait();
  const auto given =
      std::count_if(calls.begin(), calls.end(), [](const Call& call) { return call.response.has_lease(); });
  EXPECT_EQ(given, 1) << "the only task that is ready";
}

TEST_F(ServerTest, NumberOfDigestsPerCallIsLimited) {
  v1::StatBlobsRequest stat;
  for (int i = 0; i < 1000; ++i) stat.add_digests()->set_sha256(Sha256Hex(std::to_string(i)));
  const auto ask = [&] {
    grpc::ClientContext context;
    v1::StatBlobsResponse held;
    return FromGrpc(blob_service_->StatBlobs(&context, stat, &held));
  };
  EXPECT_TRUE(ask().ok());
  stat.add_digests();
  EXPECT_EQ(ask().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(ask().message()), HasSubstr("found 1001, expected at most 1000"));
}

}  // namespace
}  // namespace tessera

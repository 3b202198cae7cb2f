// Client limits and their errors; draining of a coordinator.
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <latch>
#include <set>
#include <thread>

#include "common/base/refusal.h"
#include "common/rpc/status_conversion.h"
#include "server/auth/client_limits.h"
#include "tests/unit/server/grpc/raw_call.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class LimitsTest : public ServerTest {
 protected:
  // Restarts with the changed options_ or environment_.
  void StartAgain() {
    server_->Shutdown(1);
    Restart();
    environment_.coordinator = coordinator_.get();
    Start();
  }
  static void ExpectLimit(const Status& status, const std::string& what, int64_t most, const std::string& flag) {
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_EQ(RefusalOf(status), Refusal::kLimit);
    EXPECT_EQ(LimitOf(status).what, what);
    EXPECT_EQ(LimitOf(status).most, most);
    EXPECT_EQ(LimitOf(status).flag, flag);
    EXPECT_THAT(std::string(status.message()), HasSubstr("tesserad " + flag));
  }
  Status Submit(v1::Job* job, const std::string& request_id = "") { return FromGrpc(CreateJob(job, request_id)); }

  struct Upload {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    std::unique_ptr<grpc::ClientWriter<v1::WriteBlobRequest>> writer;
    bool Write(const std::string& content, size_t bytes) {
      v1::WriteBlobRequest request;
      request.mutable_digest()->set_sha256(Sha256Hex(content));
      request.mutable_digest()->set_size_bytes(static_cast<int64_t>(content.size()));
      request.mutable_chunk()->set_data(content.substr(0, bytes));
      request.mutable_chunk()->set_xxh3(Xxh3(content.substr(0, bytes)));
      return writer->Write(request);
    }
    Status End() {
      writer->WritesDone();
      return FromGrpc(writer->Finish());
    }
  };
  // For a worker that has a lease.
  std::unique_ptr<Upload> Begin() {
    if (worker_.empty()) {
      v1::Job job;
      EXPECT_TRUE(CreateJob(&job).ok());
      worker_ = Register().worker();
      EXPECT_TRUE(LeaseOverRpc(worker_).has_lease());
    }
    auto upload = std::make_unique<Upload>();
    SetDeadline(upload->context, 60);
    As(upload->context, worker_);
    upload->writer = blob_service_->WriteBlob(&upload->context, &upload->response);
    return upload;
  }
  // Sends this number of its bytes.
  Status Send(const std::string& content, size_t bytes) {
    const auto upload = Begin();
    upload->Write(content, bytes);
    return upload->End();
  }
  int64_t Held(const std::string& content) { return blobs_->CommittedBytes(DigestOf(content)).value_or(-1); }

  std::string worker_;
};

TEST_F(LimitsTest, JobLimitsPerClientAndInTotal) {
  options_.limits = {2, 3, 4};
  StartAgain();
  v1::Job job;
  ASSERT_TRUE(Submit(&job, "a").ok());
  ASSERT_TRUE(Submit(&job).ok());
  const Status refused = Submit(&job);
  ExpectLimit(refused, "jobs of 'ipv4:127.0.0.1' that are active", 2, "--max-jobs-of-client");
  EXPECT_EQ(RetryDelayOf(refused), 0) << "the time is unknown";
  EXPECT_TRUE(Submit(&job, "a").ok()) << "the job exists";
  EXPECT_TRUE(CreateJob(&job, "", /*validate_only=*/true).ok());
  StartAgain();
  EXPECT_EQ(Submit(&job).code(), absl::StatusCode::kResourceExhausted) << "the limit holds after a restart";
  ASSERT_NE(Create(AJob(1)), "");  // of another client
  ASSERT_TRUE(coordinator_->jobs().CancelJob("jobs/1").ok());
  ASSERT_TRUE(Submit(&job).ok());
  ASSERT_TRUE(coordinator_->jobs().CancelJob("jobs/2").ok());
  ExpectLimit(Submit(&job), "stored jobs", 4, "--max-kept-jobs");
  ASSERT_TRUE(coordinator_->jobs().DeleteJob("jobs/1", "").ok());
  ASSERT_TRUE(Submit(&job).ok());
  ExpectLimit(coordinator_->jobs().CreateJob(AJob(1)).status(), "active jobs", 3, "--max-jobs");
}

TEST_F(LimitsTest, SubmitLimitIsPerClient) {
  options_.limits.of_client = 5;
  StartAgain();
  v1::Job job;
  int accepted = 0;
  for (int i = 0; i < 200; ++i) accepted += Submit(&job).ok() ? 1 : 0;
  EXPECT_EQ(accepted, 5);
  EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 1000).size(), 5u);
  EXPECT_NE(Create(AJob(1)), "");
}

TEST_F(LimitsTest, StoredSizeOfASubmissionIsLimited) {
  const auto faults = [&](const std::function<void(v1::CreateJobRequest&)>& spoil) {
    grpc::ClientContext context;
    v1::CreateJobRequest request;
    request.set_scene_path(scene_);
    spoil(request);
    v1::Job job;
    const Status status = FromGrpc(jobs_->CreateJob(&context, request, &job));
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
    const std::vector<InputFault> told = FaultsOf(status);
    return told.empty() ? "" : told[0].file + ": " + told[0].found + ", " + told[0].expected;
  };
  const std::string long_name(257, 'n');
  EXPECT_EQ(faults([&](auto& r) { r.set_display_name(long_name); }), "display_name: 257 bytes, at most 256");
  EXPECT_EQ(faults([&](auto& r) { r.set_request_id(long_name); }), "request_id: 257 bytes, at most 256");
  EXPECT_EQ(faults([&](auto& r) { r.set_scene_path("/" + std::string(4096, 'p')); }),
            "scene_path: 4097 bytes, at most 4096");
  EXPECT_THAT(faults([&](auto& r) {
                for (int i = 0; i < 100'000; ++i) r.mutable_settings()->mutable_update()->add_rollback_tiles(i);
              }),
              HasSubstr("settings: "));
  grpc::ClientContext context;
  v1::RegisterWorkerRequest registration;
  registration.set_version(kAlgorithmVersion);
  registration.set_host(long_name);
  v1::RegisterWorkerResponse registered;
  EXPECT_EQ(workers_->RegisterWorker(&context, registration, &registered).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

// Limits per client and in total; unregistering makes room.
TEST_F(LimitsTest, RegisteredWorkersAreLimited) {
  options_.worker_limits.of_client = 2;
  StartAgain();
  const auto try_register = [&] {
    grpc::ClientContext context;
    v1::RegisterWorkerRequest request;
    request.set_version(kAlgorithmVersion);
    v1::RegisterWorkerResponse response;
    return FromGrpc(workers_->RegisterWorker(&context, request, &response));
  };
  const std::string first = Register().worker();
  Register();
  const Status refused = try_register();
  ExpectLimit(refused, "workers of 'ipv4:127.0.0.1'", 2, "--max-workers-of-client");
  EXPECT_GT(RetryDelayOf(refused), 0);
  ASSERT_TRUE(UnregisterAndWait(*coordinator_, first).ok());
  EXPECT_TRUE(try_register().ok());

  options_.worker_limits = {.of_client = 100, .in_all = 3};
  StartAgain();
  for (int i = 0; i < 3; ++i) Register();
  ExpectLimit(try_register(), "workers", 3, "--max-workers");
}

TEST_F(LimitsTest, ConcurrentTransfersAreLimited) {
  environment_.limits.transfers = 2;
  StartAgain();
  const std::string content(1000, 'x');
  const auto one = Begin(), other = Begin();
  ASSERT_TRUE(one->Write("1" + content, 10));
  ASSERT_TRUE(other->Write("2" + content, 10));
  while (Held("1" + content) != 10 || Held("2" + content) != 10) std::this_thread::yield();
  const Status refused = Send("3" + content, 10);
  ExpectLimit(refused, "transfers at once of '" + worker_ + "'", 2, "--max-transfers");
  EXPECT_GT(RetryDelayOf(refused), 0);
  v1::Job job;
  EXPECT_TRUE(CreateJob(&job).ok()) << "other clients are served";
  EXPECT_TRUE(one->End().ok());
  EXPECT_TRUE(Send("3" + content, 10).ok());
}

TEST_F(LimitsTest, UnfinishedUploadsAndTheirBytesAreLimited) {
  environment_.limits.uploads = 2;
  environment_.limits.upload_bytes = 10'000;
  StartAgain();
  const std::string a(1000, 'a'), b(1000, 'b'), c(1000, 'c'), large(9001, 'd');
  ASSERT_TRUE(Send(a, 10).ok());
  ExpectLimit(Send(large, 10), "bytes of unfinished uploads of 'ipv4:127.0.0.1'", 10'000, "--max-upload-gib");
  ASSERT_TRUE(Send(b, 10).ok());
  ExpectLimit(Send(c, 10), "unfinished uploads of 'ipv4:127.0.0.1'", 2, "--max-uploads");
  EXPECT_EQ(Held(c), 0) << "no part is stored";
  EXPECT_TRUE(Send(a, 20).ok()) << "existing uploads continue";
  EXPECT_TRUE(Send(a, 1000).ok());
  EXPECT_TRUE(blobs_->Has(DigestOf(a)));
  EXPECT_TRUE(Send(c, 10).ok()) << "an upload is finished";
}

TEST_F(LimitsTest, SweptUploadsAreNotCounted) {
  ClientLimitOptions options;
  options.uploads = 1;
  ClientLimits limits(options, blobs_.get());
  const Digest first = DigestOf("first"), second = DigestOf("second");
  ASSERT_TRUE(blobs_->Append(first, 0, "fir").ok());
  ASSERT_TRUE(limits.BeginUpload("a", first).ok());
  EXPECT_FALSE(limits.BeginUpload("a", second).ok());
  EXPECT_TRUE(limits.BeginUpload("b", second).ok()) << "another client";
  ClientLimits later(options, blobs_.get());
  ASSERT_TRUE(later.BeginUpload("a", first).ok());
  ASSERT_TRUE(RemoveTree(blobs_->root() + "/partial/" + first.sha256).ok());
  EXPECT_TRUE(later.BeginUpload("a", second).ok());
}

TEST_F(LimitsTest, SilentTransferIsAborted) {
  ClientLimitOptions options;
  options.silence_s = 60;
  ClientLimits limits(options, blobs_.get());
  int broken = 0;
  auto ticket = limits.Transfer("a", [&] { ++broken; });
  auto reading = limits.Transfer("a", {});  // has no time limit
  const auto now = ClientLimits::Clock::now();
  limits.BreakOffSilent(now + std::chrono::seconds(50));
  EXPECT_EQ(broken, 0);
  limits.BreakOffSilent(now + std::chrono::seconds(70));
  EXPECT_EQ(broken, 1);
  limits.BreakOffSilent(now + std::chrono::seconds(200));
  EXPECT_EQ(broken, 1) << "aborted once";
  EXPECT_EQ(limits.transfers(), 2);
  *ticket = {};
  EXPECT_EQ(limits.transfers(), 1);
}

TEST_F(LimitsTest, SilentUploadIsAbortedOverTheNetwork) {
  environment_.limits.silence_s = 0;
  StartAgain();
  const auto upload = Begin();
  ASSERT_TRUE(upload->Write(std::string(1000, 'x'), 10));
  while (Held(std::string(1000, 'x')) != 10) std::this_thread::yield();
  server_->Tick();
  while (server_->IsBusy()) std::this_thread::yield();
  EXPECT_FALSE(upload->writer->Finish().ok());
}

TEST_F(LimitsTest, ListsArePaged) {
  for (int i = 0; i < 7; ++i) Register();
  std::vector<std::string> names;
  v1::ListWorkersRequest request;
  request.set_page_size(3);
  int pages = 0;
  do {
    grpc::ClientContext context;
    v1::ListWorkersResponse page;
    ASSERT_TRUE(workers_->ListWorkers(&context, request, &page).ok());
    EXPECT_LE(page.workers_size(), 3);
    for (const v1::Worker& worker : page.workers()) names.push_back(worker.name());
    request.set_page_token(page.next_page_token());
    ++pages;
  } while (!request.page_token().empty());
  EXPECT_EQ(pages, 3);
  EXPECT_EQ(names.size(), 7u);
  EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
}

TEST_F(LimitsTest, PagesOfJobsAreLimitedInSize) {
  environment_.read_scene = [](const std::string& path, const SceneRequest&,
                               const AllowedFiles&) -> StatusOr<SceneListing> {
    return SceneListing{path, "fake", {"image"}, Warnings(500, std::string(1000, 'w'))};
  };
  StartAgain();
  v1::Job job;
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(CreateJob(&job).ok());
  const auto bare = v1::Jobs::NewStub(
      grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials()));  // default limit of 4 MiB
  std::vector<std::string> names;
  v1::ListJobsRequest request;
  do {
    grpc::ClientContext context;
    v1::ListJobsResponse page;
    const grpc::Status status = bare->ListJobs(&context, request, &page);
    ASSERT_TRUE(status.ok()) << status.error_message();
    for (const v1::Job& each : page.jobs()) names.push_back(each.name());
    request.set_page_token(page.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_EQ(names.size(), 10u);
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), 10u);
}

// A cache that counts completely hashed files.
class NotingCache final : public DigestCache {
 public:
  std::optional<Digest> Find(const std::string&, const FileStamp&) override { return std::nullopt; }
  Status Remember(const std::string&, const FileStamp&, const Digest&) override {
    ++hashed;
    return absl::OkStatus();
  }
  std::atomic<int> hashed = 0;
};

TEST_F(LimitsTest, ExpiredCallStopsHashing) {
  NotingCache cache;
  clock_.Advance(3e9);  // the files are old enough for the cache
  std::latch reading(1), go_on(1);
  const SceneReader list = environment_.read_scene;
  environment_.digests = &cache;
  environment_.read_scene = [&](const std::string& path, const SceneRequest& request, const AllowedFiles& allowed) {
    if (!reading.try_wait()) reading.count_down();
    go_on.wait();
    return list(path, request, allowed);
  };
  StartAgain();
  std::thread caller([&] {
    grpc::ClientContext context;
    SetDeadline(context, 0.2);
    v1::CreateJobRequest request;
    request.set_scene_path(scene_);
    v1::Job job;
    EXPECT_EQ(jobs_->CreateJob(&context, request, &job).error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  });
  reading.wait();
  caller.join();
  for (int i = 0; i < 3; ++i) Register();  // on the same connection: the server has seen the deadline then
  go_on.count_down();
  while (server_->IsBusy()) std::this_thread::yield();
  EXPECT_EQ(cache.hashed, 0);
  EXPECT_TRUE(coordinator_->jobs().ListJobs(-1, 10).empty());
  v1::Job job;
  EXPECT_TRUE(CreateJob(&job).ok());
  EXPECT_GT(cache.hashed, 0) << "waiting callers get a digest";
}

TEST_F(LimitsTest, DrainingCoordinatorRefusesNewJobsAndLeases) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job, "a").ok());
  const std::string busy = Register().worker(), idle = Register().worker();
  const auto lease = Lease(busy);
  ASSERT_TRUE(lease);
  std::thread waiting([&] {
    grpc::ClientContext context;
    As(context, idle);
    v1::LeaseTaskRequest request;
    request.set_worker(idle);
    request.set_wait_s(30);
    v1::LeaseTaskResponse response;
    const Status told = FromGrpc(workers_->LeaseTask(&context, request, &response));
    EXPECT_EQ(told.code(), absl::StatusCode::kUnavailable);
    EXPECT_EQ(RefusalOf(told), Refusal::kDraining);
    EXPECT_GT(RetryDelayOf(told), 0);
  });
  worker_ = busy;
  const auto upload = Begin();
  ASSERT_TRUE(upload->Write("content", 3));
  while (!server_->IsBusy()) std::this_thread::yield();
  server_->Drain();
  waiting.join();
  EXPECT_TRUE(server_->IsBusy());
  const Status refused = Submit(&job);
  EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(RefusalOf(refused), Refusal::kDraining);
  EXPECT_TRUE(Submit(&job, "a").ok()) << "the job exists";
  EXPECT_TRUE(FromGrpc(upload->writer->WritesDone() ? upload->writer->Finish() : grpc::Status::CANCELLED).ok());
  EXPECT_TRUE(Succeed(busy, *lease).ok()) << "leased tasks continue";
  while (server_->IsBusy()) std::this_thread::yield();
}

// Lists the services as grpcurl does.
TEST_F(LimitsTest, ReflectionIsServedOnlyIfEnabled) {
  const auto ask = [&](std::string* answer) {
    const std::string list_services("\x3a\x00", 2);
    return RawCall(channel_, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", list_services, {},
                   answer)
        .error_code();
  };
  std::string answer;
  EXPECT_EQ(ask(&answer), grpc::StatusCode::UNIMPLEMENTED);
  server_->Shutdown(1);
  ListenOptions listen;
  listen.addresses = {"127.0.0.1:0"};
  listen.reflection = true;
  Restart();
  environment_.coordinator = coordinator_.get();
  server_ = *CoordinatorServer::Start(listen, environment_);
  channel_ = MakeChannel(server_->address());
  EXPECT_EQ(ask(&answer), grpc::StatusCode::OK);
  EXPECT_THAT(answer, HasSubstr("tessera.v1.Jobs"));
}

// Prefix of an enum's values: "JOB_STATE" for JobState.
std::string PrefixOf(const google::protobuf::EnumDescriptor* type) {
  std::string prefix;
  for (const char c : type->name()) {
    if (c >= 'A' && c <= 'Z' && !prefix.empty()) prefix += '_';
    prefix += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  }
  return prefix;
}

TEST(ProtoStyleTest, EnumValuesHaveTheTypeAsPrefix) {
  std::vector<const google::protobuf::EnumDescriptor*> enums;
  for (const google::protobuf::FileDescriptor* file :
       {v1::Job::descriptor()->file(), v1::Task::descriptor()->file(), v1::Worker::descriptor()->file()}) {
    for (int i = 0; i < file->enum_type_count(); ++i) enums.push_back(file->enum_type(i));
  }
  EXPECT_GE(enums.size(), 4u);
  for (const auto* type : enums) {
    const std::string prefix = PrefixOf(type);
    for (int i = 0; i < type->value_count(); ++i) {
      EXPECT_EQ(type->value(i)->name().substr(0, prefix.size() + 1), prefix + "_") << type->full_name();
    }
    EXPECT_EQ(type->FindValueByNumber(0)->name(), prefix + "_UNSPECIFIED");
  }
}

// Stored records contain the numbers.
TEST(ProtoStyleTest, NumbersAreThoseOfEarlierReleases) {
  const auto all = [](const google::protobuf::EnumDescriptor* type) {
    std::string text;
    for (int i = 0; i < type->value_count(); ++i) {
      text += std::to_string(type->value(i)->number()) + "_" +
              type->value(i)->name().substr(PrefixOf(type).size() + 1) + " ";
    }
    return text;
  };
  EXPECT_EQ(all(v1::JobState_descriptor()),
            "0_UNSPECIFIED 1_QUEUED 2_RUNNING 3_SUCCEEDED 4_FAILED 5_CANCELLED 6_PARTIAL ");
  EXPECT_EQ(all(v1::TaskState_descriptor()),
            "0_UNSPECIFIED 1_WAITING 2_READY 3_LEASED 4_SUCCEEDED 5_FAILED 6_CANCELLED ");
  EXPECT_EQ(all(v1::ErrorClass_descriptor()),
            "0_UNSPECIFIED 1_INPUT 2_TRANSIENT 3_MEMORY 4_POISON 5_PREEMPTED 6_LOST_INPUT 7_SCRATCH 8_STORAGE 9_PEER "
            "10_INTERNAL ");
  EXPECT_EQ(all(v1::AttemptOutcome_descriptor()),
            "0_UNSPECIFIED 1_RUNNING 2_SUCCEEDED 3_FAILED 4_LEASE_EXPIRED 5_CANCELLED ");
}

}  // namespace
}  // namespace tessera

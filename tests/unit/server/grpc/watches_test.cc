// Watches of jobs: many, slow, idle and resumed ones.
#include <gmock/gmock.h>

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <thread>

#include "common/base/refusal.h"
#include "common/rpc/status_conversion.h"
#include "server/grpc/job_watches.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// A watch that is read by gRPC's threads and records the updates.
class Reader final : public grpc::ClientReadReactor<v1::WatchJobResponse> {
 public:
  Reader(v1::Jobs::Stub& stub, const std::string& job) {
    request_.set_name(job);
    SetDeadline(context_, 60);
    stub.async()->WatchJob(&context_, &request_, this);
    StartRead(&update_);
    StartCall();
  }
  ~Reader() override {
    context_.TryCancel();
    Wait([](const Reader& reader) { return reader.done_; });
  }
  void OnReadDone(bool ok) override {
    if (!ok) return;
    {
      std::lock_guard lock(mutex_);
      ++updates_;
      last_ = update_;
    }
    changed_.notify_all();
    StartRead(&update_);
  }
  void OnDone(const grpc::Status& status) override {
    std::lock_guard lock(mutex_);
    status_ = status;
    done_ = true;
    changed_.notify_all();
  }
  // Calls `condition` with the lock held.
  bool Wait(const std::function<bool(const Reader&)>& condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(60), [&] { return condition(*this); });
  }
  bool AwaitPriority(int priority) {
    return Wait([&](const Reader& r) { return r.updates_ > 0 && r.last_.job().priority() == priority; });
  }
  grpc::Status AwaitEnd() {
    EXPECT_TRUE(Wait([](const Reader& reader) { return reader.done_; }));
    return status_;
  }
  int updates() const { return updates_; }
  v1::JobState state() {
    std::lock_guard lock(mutex_);
    return last_.job().state();
  }

 private:
  grpc::ClientContext context_;
  v1::WatchJobRequest request_;
  v1::WatchJobResponse update_;
  std::mutex mutex_;
  std::condition_variable changed_;
  v1::WatchJobResponse last_;
  int updates_ = 0;
  bool done_ = false;
  grpc::Status status_;
};

class WatchesTest : public ServerTest {
 protected:
  std::string AJobOnTheWire() {
    v1::Job job;
    EXPECT_TRUE(CreateJob(&job).ok());
    return job.name();
  }
  void SetPriority(const std::string& job, int priority) {
    ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {priority, {}}).ok());
  }
  struct Stream {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::WatchJobResponse>> reader;
  };
  std::unique_ptr<Stream> Watch(const std::string& job, const std::string& seen_etag = "") {
    auto stream = std::make_unique<Stream>();
    SetDeadline(stream->context, 60);
    v1::WatchJobRequest request;
    request.set_name(job);
    request.set_seen_etag(seen_etag);
    stream->reader = jobs_->WatchJob(&stream->context, request);
    return stream;
  }
  static int Threads() {
    const auto tasks = std::filesystem::directory_iterator("/proc/self/task");
    return static_cast<int>(std::distance(begin(tasks), end(tasks)));
  }
  // Starts another coordinator with the same records.
  void StartAgain() {
    server_->Shutdown(1);
    Restart();
    environment_.coordinator = coordinator_.get();
    Start();
  }
};

TEST_F(WatchesTest, ManyWatchesShareThreadsAndAllAreUpdated) {
  constexpr int kConnections = 10, kWatches = 1000;
  const std::string job = AJobOnTheWire();
  std::vector<std::unique_ptr<v1::Jobs::Stub>> stubs;
  for (int i = 0; i < kConnections; ++i) stubs.push_back(v1::Jobs::NewStub(MakeChannel(server_->address())));
  Reader first(*stubs[0], job);
  ASSERT_TRUE(first.AwaitPriority(0));
  const int threads = Threads();
  std::vector<std::unique_ptr<Reader>> readers;
  for (int i = 0; i < kWatches - 1; ++i) readers.push_back(std::make_unique<Reader>(*stubs[i % kConnections], job));
  for (const auto& reader : readers) ASSERT_TRUE(reader->AwaitPriority(0));
  EXPECT_LT(Threads(), threads + 50);
  SetPriority(job, 7);
  for (const auto& reader : readers) ASSERT_TRUE(reader->AwaitPriority(7));
  Reader refused(*stubs[0], job);
  const Status limit = FromGrpc(refused.AwaitEnd());
  EXPECT_EQ(limit.code(), absl::StatusCode::kResourceExhausted);
  ASSERT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  for (const auto& reader : readers) EXPECT_TRUE(reader->AwaitEnd().ok());
}

// The messages are larger than the flow control window of a stream that is not read.
TEST_F(WatchesTest, SlowWatcherGetsTheNewestState) {
  environment_.read_scene = [](const std::string& path, const SceneRequest&,
                               const AllowedFiles&) -> StatusOr<SceneListing> {
    return SceneListing{path, "fake", {"image"}, Warnings(50, std::string(4000, 'w'))};
  };
  StartAgain();
  const std::string job = AJobOnTheWire();
  grpc::ChannelArguments small_window;
  small_window.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  small_window.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 64 << 10);
  jobs_ = v1::Jobs::NewStub(
      grpc::CreateCustomChannel(server_->address(), grpc::InsecureChannelCredentials(), small_window));
  const auto slow = Watch(job);
  v1::WatchJobResponse update;
  ASSERT_TRUE(slow->reader->Read(&update));  // then stop reading
  Reader fast(*v1::Jobs::NewStub(MakeChannel(server_->address())), job);
  constexpr int kChanges = 6;
  for (int priority = 1; priority <= kChanges; ++priority) {
    SetPriority(job, priority);
    ASSERT_TRUE(fast.AwaitPriority(priority));
  }
  std::vector<int> seen;
  while (slow->reader->Read(&update)) {
    seen.push_back(update.job().priority());
    if (seen.back() == kChanges) break;
  }
  ASSERT_FALSE(seen.empty());
  EXPECT_EQ(seen.back(), kChanges);
  EXPECT_LE(seen.size(), 3u) << "the messages in flight and the newest";
  EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
  ASSERT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  while (slow->reader->Read(&update)) {
  }
  EXPECT_EQ(update.job().state(), v1::JOB_STATE_CANCELLED);
  EXPECT_TRUE(slow->reader->Finish().ok());
}

TEST_F(WatchesTest, StreamResumesFromEtag) {
  const std::string job = AJobOnTheWire();
  v1::WatchJobResponse update;
  const auto first = Watch(job);
  ASSERT_TRUE(first->reader->Read(&update));
  const std::string etag = update.etag();
  EXPECT_NE(etag, "");
  first->context.TryCancel();

  const auto second = Watch(job, etag);
  Reader another(*jobs_, job);  // gets an update at once, `second` does not
  ASSERT_TRUE(another.AwaitPriority(0));
  SetPriority(job, 3);
  ASSERT_TRUE(second->reader->Read(&update));
  EXPECT_EQ(update.job().priority(), 3) << "the first change since `etag`";
  EXPECT_NE(update.etag(), etag);

  StartAgain();
  EXPECT_FALSE(second->reader->Read(&update));
  const Status broken = FromGrpc(second->reader->Finish());
  EXPECT_EQ(broken.code(), absl::StatusCode::kUnavailable) << broken;
  EXPECT_GT(RetryDelayOf(broken), 0);
  const auto third = Watch(job, update.etag());
  Reader witness(*jobs_, job);
  ASSERT_TRUE(witness.AwaitPriority(3));
  SetPriority(job, 4);
  ASSERT_TRUE(third->reader->Read(&update));
  EXPECT_EQ(update.job().priority(), 4) << "also after a restart of the coordinator";

  ASSERT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  ASSERT_TRUE(third->reader->Read(&update));
  EXPECT_EQ(update.job().state(), v1::JOB_STATE_CANCELLED);
  EXPECT_FALSE(third->reader->Read(&update)) << "no update follows the end";
  EXPECT_TRUE(third->reader->Finish().ok());
  const std::string end = update.etag();
  const auto fourth = Watch(job, end);
  EXPECT_FALSE(fourth->reader->Read(&update)) << "the caller has the final state";
  EXPECT_TRUE(fourth->reader->Finish().ok());
  const auto fifth = Watch(job, etag);
  EXPECT_TRUE(fifth->reader->Read(&update)) << "the caller does not have the final state";
  EXPECT_EQ(update.etag(), end);
}

TEST_F(WatchesTest, JobEndIsSentOnlyWhenDurable) {
  options_.durable_wait_s = 0.05;
  StartAgain();
  const std::string job = AJobOnTheWire();
  Reader reader(*jobs_, job);
  ASSERT_TRUE(reader.AwaitPriority(0));
  store_.fail = true;
  EXPECT_FALSE(coordinator_->jobs().CancelJob(job).ok());
  EXPECT_TRUE(reader.Wait([](const Reader& r) { return r.updates() >= 2; })) << "the end is not stored yet";
  EXPECT_NE(reader.state(), v1::JOB_STATE_CANCELLED);
  store_.fail = false;
  EXPECT_TRUE(reader.AwaitEnd().ok());
  EXPECT_EQ(reader.state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(WatchesTest, WatchesPerClientAreLimited) {
  environment_.limits.watches = 3;
  StartAgain();
  const std::string job = AJobOnTheWire();
  std::vector<std::unique_ptr<Stream>> held;
  v1::WatchJobResponse update;
  for (int i = 0; i < 3; ++i) {
    held.push_back(Watch(job));
    ASSERT_TRUE(held.back()->reader->Read(&update));
  }
  const auto refused = Watch(job);
  EXPECT_FALSE(refused->reader->Read(&update));
  const Status status = FromGrpc(refused->reader->Finish());
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(RefusalOf(status), Refusal::kLimit);
  EXPECT_EQ(LimitOf(status).what, "watches of 'ipv4:127.0.0.1'");
  EXPECT_EQ(LimitOf(status).most, 3);
  EXPECT_EQ(LimitOf(status).flag, "--max-watches");
  EXPECT_GT(RetryDelayOf(status), 0);
  EXPECT_THAT(std::string(status.message()), HasSubstr("limit 3 reached (tesserad --max-watches)"));
  held[0]->context.TryCancel();
  EXPECT_FALSE(held[0]->reader->Read(&update));
  held[0]->reader->Finish();
  for (bool let_in = false; !let_in;) let_in = Watch(job)->reader->Read(&update);  // after the cancellation
}

TEST_F(WatchesTest, LocalWatchesReadTheNewestStateAndTheEnd) {
  using Event = JobWatches::Local::Event;
  JobWatches& watches = server_->watches();
  EXPECT_EQ(watches.Open("anna", "jobs/9", "").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(watches.Newest("jobs/9").status().code(), absl::StatusCode::kNotFound);
  const std::string job = AJobOnTheWire();
  const auto watch = *watches.Open("anna", job, "");
  std::shared_ptr<const JobUpdate> update;
  ASSERT_EQ(watch->Read(60, &update), Event::kUpdate);
  v1::WatchJobResponse state;
  ASSERT_TRUE(state.ParseFromString(update->message));
  EXPECT_EQ(state.job().name(), job);
  EXPECT_EQ(state.etag(), update->etag);
  EXPECT_EQ(watch->Read(0, &update), Event::kTimeout);
  const auto second = *watches.Open("anna", job, update->etag);
  EXPECT_EQ(second->Read(0, &update), Event::kTimeout) << "the caller has the state";
  SetPriority(job, 3);
  for (const auto* reader : {&watch, &second}) {
    ASSERT_EQ((*reader)->Read(60, &update), Event::kUpdate);
    ASSERT_TRUE(state.ParseFromString(update->message));
    EXPECT_EQ(state.job().priority(), 3);
  }
  EXPECT_EQ((*watches.Newest(job))->number, update->number);
  ASSERT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  ASSERT_EQ(watch->Read(60, &update), Event::kUpdate);
  EXPECT_TRUE(update->last);
  EXPECT_EQ(watch->Read(60, &update), Event::kEnd);
  EXPECT_TRUE(watch->status().ok());
  const auto third = *watches.Open("anna", job, update->etag);
  EXPECT_EQ(third->Read(60, &update), Event::kEnd) << "the caller has the final state";
}

TEST_F(WatchesTest, LocalWatchesCountAndEndWithTheirReason) {
  using Event = JobWatches::Local::Event;
  environment_.limits.watches = 1;
  StartAgain();
  const std::string job = AJobOnTheWire();
  std::shared_ptr<const JobUpdate> update;
  {
    const auto watch = *server_->watches().Open("anna", job, "");
    EXPECT_EQ(LimitOf(server_->watches().Open("anna", job, "").status()).what, "watches of 'anna'");
    EXPECT_EQ(watch->Read(60, &update), Event::kUpdate);
    server_->Shutdown(1);
    EXPECT_EQ(watch->Read(60, &update), Event::kEnd);
    EXPECT_EQ(watch->status().code(), absl::StatusCode::kUnavailable) << watch->status();
  }
  StartAgain();
  EXPECT_TRUE(server_->watches().Open("anna", job, "").ok());
}

TEST_F(WatchesTest, WatchOfDeletedOrUnknownJobEndsWithReason) {
  v1::WatchJobResponse update;
  const auto unknown = Watch("jobs/9");
  EXPECT_FALSE(unknown->reader->Read(&update));
  EXPECT_EQ(unknown->reader->Finish().error_code(), grpc::StatusCode::NOT_FOUND);
}

}  // namespace
}  // namespace tessera

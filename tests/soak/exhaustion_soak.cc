// Overload of a real coordinator with submissions, watches and uploads: its memory stays bounded, it reports its
// limits, and it serves other clients meanwhile.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "common/base/refusal.h"
#include "common/base/version.h"
#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "tessera/v1/blobs.grpc.pb.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/e2e/leased_worker.h"
#include "tests/e2e/programs.h"

namespace tessera::soak {
namespace {

using Steady = std::chrono::steady_clock;

constexpr double kCallSeconds = 60;
constexpr int kUploadsOfWorker = 200;
constexpr int64_t kMaxResidentBytes = int64_t{1} << 30;

struct Sizes {
  int submits = 100'000, jobs = 1000;
  int watches = 10'000, connections = 100, changes = 10;
  int uploads = 1000;
};

class Broken : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

void Require(bool condition, const std::string& what) {
  if (!condition) throw Broken(what);
}

double SecondsSince(Steady::time_point start) { return std::chrono::duration<double>(Steady::now() - start).count(); }

// A number of /proc/PID/status.
int64_t OfStatus(pid_t pid, const std::string& name) {
  std::ifstream status("/proc/" + std::to_string(pid) + "/status");
  for (std::string word; status >> word;) {
    int64_t value = 0;
    if (word == name + ":" && status >> value) return value;
  }
  return 0;
}

double CpuSeconds(pid_t pid) {
  std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
  std::string skipped;
  for (int i = 0; i < 13; ++i) stat >> skipped;  // the program's name has no space
  double user = 0, system = 0;
  stat >> user >> system;
  return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

class Coordinator {
 public:
  Coordinator(const std::string& folder, const Sizes& sizes)
      : socket_("unix:" + folder + "/socket"),
        program_(folder, TESSERAD_PROGRAM,
                 {"--data", folder + "/data", "--listen", "127.0.0.1:0", "--listen", socket_, "--port-file",
                  folder + "/address", "--scene-root", "/", "--log-level", "warn", "--max-watches",
                  std::to_string(sizes.watches), "--max-jobs-of-client", std::to_string(sizes.jobs), "--max-transfers",
                  std::to_string(kUploadsOfWorker)}) {
    const std::string port_file = folder + "/address";
    Require(e2e::WaitUntil([&] { return FileExists(port_file) || !program_.Running(); }) && program_.Running(),
            program_.Output());
    address_ = e2e::Content(port_file);
    address_.erase(address_.find_last_not_of('\n') + 1);
  }
  const std::string& address() const { return address_; }
  const std::string& socket() const { return socket_; }
  void Show(const char* after) {
    Require(program_.Running(), program_.ExitDescription() + "\n" + program_.Output());
    const int64_t most = OfStatus(program_.pid(), "VmHWM") << 10;
    const double cpu_s = CpuSeconds(program_.pid());
    std::printf("  coordinator: %.1f core-seconds for %s; %lld MiB resident, at most %lld MiB; %lld threads\n",
                cpu_s - cpu_s_, after, static_cast<long long>(OfStatus(program_.pid(), "VmRSS") >> 10),
                static_cast<long long>(most >> 20), static_cast<long long>(OfStatus(program_.pid(), "Threads")));
    cpu_s_ = cpu_s;
    std::fflush(stdout);
    Require(most <= kMaxResidentBytes, "it has taken more than 1 GiB");
  }

 private:
  const std::string socket_;
  e2e::Program program_;
  double cpu_s_ = 0;
  std::string address_;
};

// Somebody else, who asks about a job over and over.
class Bystander {
 public:
  Bystander(const std::string& address, const std::string& job)
      : jobs_(v1::Jobs::NewStub(MakeChannel(address))), thread_([this, job] { Ask(job); }) {}
  ~Bystander() {
    stop_ = true;
    thread_.join();
  }
  void Show() {
    // What is over soon may be over before the first answer.
    const bool served = e2e::WaitUntil([&] {
      std::lock_guard lock(mutex_);
      return calls_ > 0;
    });
    stop_ = true;
    std::lock_guard lock(mutex_);
    Require(error_.ok(), "somebody else was not served: " + error_.ToString());
    Require(served, "somebody else was not served at all");
    std::printf("  somebody else meanwhile: %d calls, %.0f ms at most\n", calls_, 1e3 * longest_s_);
  }

 private:
  void Ask(const std::string& job) {
    while (!stop_) {
      const auto begun = Steady::now();
      grpc::ClientContext context;
      SetDeadline(context, kCallSeconds);
      v1::GetJobRequest request;
      request.set_name(job);
      v1::Job answer;
      const Status status = FromGrpc(jobs_->GetJob(&context, request, &answer));
      {
        std::lock_guard lock(mutex_);
        if (!status.ok()) error_ = status;
        ++calls_;
        longest_s_ = std::max(longest_s_, SecondsSince(begun));
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

  std::unique_ptr<v1::Jobs::Stub> jobs_;
  std::mutex mutex_;
  Status error_;
  int calls_ = 0;
  double longest_s_ = 0;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

StatusOr<std::string> Submit(v1::Jobs::Stub& jobs, const std::string& scene) {
  grpc::ClientContext context;
  SetDeadline(context, kCallSeconds);
  v1::CreateJobRequest request;
  request.set_scene_path(scene);
  request.mutable_settings()->set_tiles(2);
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(FromGrpc(jobs.CreateJob(&context, request, &job)));
  return job.name();
}

void Submissions(Coordinator& coordinator, const std::string& scene, const std::string& others_job,
                 const Sizes& sizes) {
  constexpr int kCallers = 16;
  Bystander bystander(coordinator.socket(), others_job);
  std::atomic<int> begun = 0, accepted = 0, refused = 0;
  std::mutex mutex;
  Status other;
  const auto start = Steady::now();
  {
    std::vector<std::jthread> callers;
    for (int i = 0; i < kCallers; ++i) {
      callers.emplace_back([&] {
        const auto jobs = v1::Jobs::NewStub(MakeChannel(coordinator.address()));
        while (begun++ < sizes.submits) {
          const auto job = Submit(*jobs, scene);
          if (job.ok()) {
            ++accepted;
          } else if (LimitOf(job.status()).flag == "--max-jobs-of-client") {
            ++refused;
          } else {
            std::lock_guard lock(mutex);
            other = job.status();
          }
        }
      });
    }
  }
  std::printf("%d submissions of one client in %.1f s: %d accepted, %d refused with the limit\n", sizes.submits,
              SecondsSince(start), accepted.load(), refused.load());
  Require(other.ok(), "a submission failed otherwise: " + other.ToString());
  Require(accepted <= sizes.jobs && accepted + refused == sizes.submits, "the limit was not kept");
  bystander.Show();
  const auto others = Submit(*v1::Jobs::NewStub(MakeChannel(coordinator.socket())), scene);
  Require(others.ok(), "somebody else may submit nothing: " + others.status().ToString());
  coordinator.Show("submissions");
}

// Priorities that all watches have been told.
class Told {
 public:
  explicit Told(int watches) : watches_(watches) {}
  void Add(int priority, double s) {
    std::lock_guard lock(mutex_);
    if (priority != awaited_) return;
    last_s_ = std::max(last_s_, s);
    if (++count_ == watches_) changed_.notify_all();
  }
  void Fail(const Status& status) {
    std::lock_guard lock(mutex_);
    if (!closing_) error_ = status;
    changed_.notify_all();
  }
  void Await(int priority) {
    std::lock_guard lock(mutex_);
    awaited_ = priority;
    count_ = 0;
    last_s_ = 0;
  }
  // When the last was told.
  double Wait() {
    std::unique_lock lock(mutex_);
    const bool all =
        changed_.wait_for(lock, std::chrono::seconds(60), [&] { return count_ == watches_ || !error_.ok(); });
    Require(error_.ok(), "a watch ended: " + error_.ToString());
    Require(all, std::to_string(count_) + " of " + std::to_string(watches_) + " watches were told");
    return last_s_;
  }
  void Close() {
    std::lock_guard lock(mutex_);
    closing_ = true;
  }

 private:
  const int watches_;
  std::mutex mutex_;
  std::condition_variable changed_;
  int awaited_ = 0, count_ = 0;
  double last_s_ = 0;
  bool closing_ = false;
  Status error_;
};

class Watch final : public grpc::ClientReadReactor<v1::WatchJobResponse> {
 public:
  Watch(v1::Jobs::Stub& jobs, const std::string& job, Steady::time_point epoch, Told& told)
      : epoch_(epoch), told_(told) {
    request_.set_name(job);
    jobs.async()->WatchJob(&context_, &request_, this);
    StartRead(&update_);
    StartCall();
  }
  void OnReadDone(bool ok) override {
    if (!ok) return;
    told_.Add(update_.job().priority(), SecondsSince(epoch_));
    StartRead(&update_);
  }
  void OnDone(const grpc::Status& status) override {
    told_.Fail(FromGrpc(status));
    std::lock_guard lock(mutex_);
    done_ = true;
    changed_.notify_all();
  }
  void Cancel() { context_.TryCancel(); }
  void Join() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return done_; });
  }

 private:
  const Steady::time_point epoch_;
  Told& told_;
  grpc::ClientContext context_;
  v1::WatchJobRequest request_;
  v1::WatchJobResponse update_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool done_ = false;
};

void Watches(Coordinator& coordinator, const std::string& job, const Sizes& sizes) {
  const auto epoch = Steady::now();
  Told told(sizes.watches);
  std::vector<std::unique_ptr<v1::Jobs::Stub>> connections;
  for (int i = 0; i < sizes.connections; ++i) {
    connections.push_back(v1::Jobs::NewStub(MakeChannel(coordinator.address())));
  }
  std::vector<std::unique_ptr<Watch>> watches;
  for (int i = 0; i < sizes.watches; ++i) {
    watches.push_back(std::make_unique<Watch>(*connections[i % sizes.connections], job, epoch, told));
  }
  std::printf("%d watches of a job over %d connections: first told within %.1f s\n", sizes.watches, sizes.connections,
              told.Wait());
  Bystander bystander(coordinator.socket(), job);
  const auto others = v1::Jobs::NewStub(MakeChannel(coordinator.socket()));
  std::vector<double> took_s;
  for (int priority = 1; priority <= sizes.changes; ++priority) {
    told.Await(priority);
    grpc::ClientContext context;
    v1::ChangeJobRequest change;
    change.set_name(job);
    change.set_priority(priority);
    v1::Job changed;
    const double begun_s = SecondsSince(epoch);
    Require(others->ChangeJob(&context, change, &changed).ok(), "the job cannot be changed");
    took_s.push_back(told.Wait() - begun_s);
  }
  std::sort(took_s.begin(), took_s.end());
  std::printf("  a change of it until the last was told: %.2f s median, %.2f s most of %d\n", took_s[took_s.size() / 2],
              took_s.back(), sizes.changes);
  grpc::ClientContext context;
  v1::WatchJobRequest request;
  request.set_name(job);
  v1::WatchJobResponse update;
  const auto reader = connections[0]->WatchJob(&context, request);
  Require(!reader->Read(&update), "one more is let in");
  Require(LimitOf(FromGrpc(reader->Finish())).flag == "--max-watches", "one more is not told the limit");
  bystander.Show();
  coordinator.Show("watches");
  told.Close();
  for (const auto& watch : watches) watch->Cancel();
  for (const auto& watch : watches) watch->Join();
}

// A worker with a lease, over a connection of its own.
class Uploader {
 public:
  explicit Uploader(const std::string& address) {
    const auto channel = e2e::ConnectLeasedWorker(address);
    Require(channel.ok(), channel.status().ToString());
    blobs_ = v1::Blobs::NewStub(*channel);
  }
  // Some bytes of a large blob, and no more.
  void Begin(int number) {
    auto& upload = uploads_.emplace_back(std::make_unique<Upload>());
    upload->writer = blobs_->WriteBlob(&upload->context, &upload->response);
    const std::string bytes(64 << 10, 'x');
    v1::WriteBlobRequest request;
    request.mutable_digest()->set_sha256(Sha256Hex("blob " + std::to_string(number)));
    request.mutable_digest()->set_size_bytes(10 << 20);
    request.mutable_chunk()->set_data(bytes);
    request.mutable_chunk()->set_xxh3(Xxh3(bytes));
    upload->writer->Write(request);
  }
  Status EndLast() {
    const auto last = std::move(uploads_.back());
    uploads_.pop_back();
    last->writer->WritesDone();
    return FromGrpc(last->writer->Finish());
  }
  void Cancel() {
    for (const auto& upload : uploads_) upload->context.TryCancel();
    for (const auto& upload : uploads_) upload->writer->Finish();
  }

 private:
  struct Upload {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    std::unique_ptr<grpc::ClientWriter<v1::WriteBlobRequest>> writer;
  };
  std::unique_ptr<v1::Blobs::Stub> blobs_;
  std::vector<std::unique_ptr<Upload>> uploads_;
};

void Uploads(Coordinator& coordinator, const std::string& job, const std::string& blobs, const Sizes& sizes) {
  Bystander bystander(coordinator.socket(), job);
  std::vector<std::unique_ptr<Uploader>> uploaders;
  for (int i = 0; i < sizes.uploads; ++i) {
    if (i % kUploadsOfWorker == 0) uploaders.push_back(std::make_unique<Uploader>(coordinator.address()));
    uploaders.back()->Begin(i);
  }
  const auto begun = [&] {
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(blobs + "/partial")) {
      count += entry.file_size() > 0 ? 1 : 0;
    }
    return count;
  };
  Require(e2e::WaitUntil([&] { return begun() == sizes.uploads; }), "not all uploads were taken");
  std::printf("%d uploads that have come to a stop\n", begun());
  if (sizes.uploads >= kUploadsOfWorker) {
    uploaders.front()->Begin(sizes.uploads);
    Require(LimitOf(uploaders.front()->EndLast()).flag == "--max-transfers", "one more is not told the limit");
  }
  bystander.Show();
  coordinator.Show("uploads");
  for (const auto& uploader : uploaders) uploader->Cancel();
}

void Run(const Sizes& sizes) {
  const TempFolder folder = TempFolder::Create("", "exhaustion-").value();
  const std::string scene = e2e::ToyCity();
  Coordinator coordinator(folder.path(), sizes);
  const auto job = Submit(*v1::Jobs::NewStub(MakeChannel(coordinator.socket())), scene);
  Require(job.ok(), job.status().ToString());
  coordinator.Show("its start");
  Submissions(coordinator, scene, *job, sizes);
  Watches(coordinator, *job, sizes);
  Uploads(coordinator, *job, folder.path() + "/data/blobs", sizes);
}

}  // namespace
}  // namespace tessera::soak

int main(int argc, char** argv) {
  tessera::soak::Sizes sizes;
  CLI::App app("Many of everything at once on a coordinator; exit code 1 if it takes more than 1 GiB or fails anybody");
  app.add_option("--submits", sizes.submits, "of one client")->capture_default_str();
  app.add_option("--jobs", sizes.jobs, "that it may have")->capture_default_str();
  app.add_option("--watches", sizes.watches)->capture_default_str();
  app.add_option("--connections", sizes.connections, "that watch")->capture_default_str();
  app.add_option("--uploads", sizes.uploads, "that come to a stop")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    tessera::soak::Run(sizes);
  } catch (const tessera::soak::Broken& broken) {
    std::fprintf(stderr, "exhaustion_soak: %s\n", broken.what());
    return 1;
  }
  return 0;
}

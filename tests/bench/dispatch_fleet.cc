#include "tests/bench/dispatch_fleet.h"

#include <grpcpp/grpcpp.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <mutex>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "common/access/secrets.h"
#include "common/base/clock.h"
#include "common/base/version.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/http/http_server.h"
#include "server/jobs/coordinator.h"
#include "server/store/sqlite_store.h"
#include "server/tesserad/logging.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/bench/bench_coordinator.h"
#include "tests/bench/page_clients.h"

namespace tessera {
namespace {

// By which the processes find each other.
struct Files {
  std::string address, page_address;  // of the coordinator and of its HTTP server, while they serve
  std::string open_pages;             // exists while pages are open
};

using SteadyTime = std::chrono::steady_clock::time_point;

SteadyTime Now() { return std::chrono::steady_clock::now(); }
double SecondsSince(SteadyTime start) { return std::chrono::duration<double>(Now() - start).count(); }

double ResidentBytes() {
  double pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

// Chains of steps, one a worker, then publish.
class ChainPlanner : public Planner {
 public:
  explicit ChainPlanner(const FleetArguments& arguments) : arguments_(arguments) {}
  StatusOr<std::vector<PlannedTask>> Ingest(const JobSettings&, const std::vector<std::string>&,
                                            const std::vector<int64_t>&) override {
    return std::vector<PlannedTask>{{kIngestKind, "ingest", -1, "{}", 1, {}}};
  }
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings&, const std::string&, const std::vector<std::string>&,
                                           const UpdateBase*, const FinePart*) override {
    std::vector<PlannedTask> tasks;
    tasks.reserve(arguments_.tasks + 1);
    const int chains = arguments_.workers;
    for (int i = 0; i < arguments_.tasks; ++i) {
      const int tile = i % chains, step = i / chains;
      std::string parameters = "{\"tile\":" + std::to_string(tile) + ",\"step\":" + std::to_string(step) + ",\"x\":\"";
      parameters.resize(398, 'x');
      tasks.push_back({"solve",
                       "solve tile " + std::to_string(tile) + " step " + std::to_string(step),
                       tile,
                       parameters + "\"}",
                       0.01,
                       {}});
      tasks.back().inputs.push_back({TaskId(step == 0 ? 0 : 1 + i - chains), step == 0 ? kSurveyFile : kStateFile});
    }
    PlannedTask publish{kPublishKind, "publish", -1, "{}", 1, {}};
    for (int i = std::max(0, arguments_.tasks - chains); i < arguments_.tasks; ++i) {
      publish.inputs.push_back({TaskId(1 + i), kStateFile, i});
    }
    tasks.push_back(std::move(publish));
    return tasks;
  }

 private:
  const FleetArguments arguments_;
};

// Times in milliseconds.
class Latencies {
 public:
  void Add(double ms) {
    std::lock_guard lock(mutex_);
    all_.push_back(ms);
  }
  void Print(const char* what) {
    std::sort(all_.begin(), all_.end());
    const auto at = [&](double share) {
      return all_[static_cast<size_t>(share * static_cast<double>(all_.size() - 1))];
    };
    if (all_.empty()) return;
    std::printf("%s: %zu, ms: median %.1f, 99 %% %.1f, 99.9 %% %.1f, most %.1f\n", what, all_.size(), at(.5), at(.99),
                at(.999), all_.back());
  }

 private:
  std::mutex mutex_;
  std::vector<double> all_;
};

// Calls functions when their time has come.
class Timers {
 public:
  Timers() : thread_([this] { Run(); }) {}
  ~Timers() {
    {
      std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  void At(SteadyTime when, std::function<void()> call) {
    std::lock_guard lock(mutex_);
    calls_.emplace(when, std::move(call));
    changed_.notify_all();
  }

 private:
  void Run() {
    std::unique_lock lock(mutex_);
    while (!stop_) {
      if (calls_.empty()) {
        changed_.wait(lock);
      } else if (const SteadyTime next = calls_.begin()->first; next > Now()) {
        changed_.wait_until(lock, next);
      } else {
        const auto call = std::move(calls_.begin()->second);
        calls_.erase(calls_.begin());
        lock.unlock();
        call();
        lock.lock();
      }
    }
  }
  std::mutex mutex_;
  std::condition_variable changed_;
  std::multimap<SteadyTime, std::function<void()>> calls_;
  bool stop_ = false;
  std::thread thread_;
};

struct Fleet {
  FleetArguments arguments;
  std::string token;
  Digest output;  // all that tasks make
  Latencies leases, reports, heartbeats;
  Timers timers;
  std::atomic<int> calls = 0;  // under way
  std::atomic<int> errors = 0;
  std::atomic<bool> stop = false;
};

// One worker: lease, work, report, which brings the next lease where there is one, and again; a heartbeat a second.
// Calls go on from their answers. Work takes from a half to one and a half times as long as asked for, so that the
// workers do not all come back at once.
class FleetWorker {
 public:
  // `ca`: of the coordinator's certificate; empty: no TLS, and no token.
  FleetWorker(Fleet& fleet, const std::string& address, const std::string& ca, int index)
      : fleet_(fleet), random_(index) {
    grpc::ChannelArguments own_connection;
    own_connection.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    auto credentials = grpc::InsecureChannelCredentials();
    if (!ca.empty()) {
      grpc::SslCredentialsOptions tls;
      tls.pem_root_certs = ca;
      credentials = grpc::SslCredentials(tls);
    }
    stub_ = v1::Workers::NewStub(grpc::CreateCustomChannel(address, credentials, own_connection));
  }

  Status Register(const std::string& host) {
    grpc::ClientContext context;
    ShowToken(context);
    v1::RegisterWorkerRequest request;
    request.set_host(host);
    request.set_threads(1);
    request.set_version(kAlgorithmVersion);
    v1::RegisterWorkerResponse response;
    const grpc::Status status = stub_->RegisterWorker(&context, request, &response);
    name_ = response.worker();
    secret_ = response.secret();
    return status.ok() ? absl::OkStatus() : absl::UnavailableError(status.error_message());
  }

  void Start() {
    Lease();
    // Each at another time of the second.
    fleet_.timers.At(Now() + std::chrono::microseconds(std::uniform_int_distribution(0, 1'000'000)(random_)),
                     [this] { Heartbeat(); });
  }

 private:
  template <class Request, class Response>
  struct Call {
    explicit Call(const FleetWorker& worker) {
      worker.ShowToken(context);
      context.AddMetadata(kWorkerMetadata, worker.name_);
      context.AddMetadata(kWorkerSecretMetadata, worker.secret_);
    }
    grpc::ClientContext context;
    Request request;
    Response response;
  };

  void ShowToken(grpc::ClientContext& context) const {
    if (!fleet_.token.empty()) context.AddMetadata("authorization", "Bearer " + fleet_.token);
  }

  void Lease() {
    if (fleet_.stop) return;
    auto* call = new Call<v1::LeaseTaskRequest, v1::LeaseTaskResponse>(*this);
    call->request.set_worker(name_);
    call->request.set_wait_s(5);
    call->request.set_call(lease_call_);
    const SteadyTime start = Now();
    ++fleet_.calls;
    stub_->async()->LeaseTask(&call->context, &call->request, &call->response,
                              [this, call, start](grpc::Status status) {
                                if (!status.ok()) ++fleet_.errors;
                                if (status.ok()) ++lease_call_;
                                if (status.ok() && call->response.has_lease()) {
                                  // The first waited for the plan.
                                  if (std::exchange(has_leased_, true)) fleet_.leases.Add(1e3 * SecondsSince(start));
                                  DoTask(call->response.lease());
                                } else {
                                  Lease();
                                }
                                delete call;
                                --fleet_.calls;
                              });
  }

  void DoTask(const v1::Lease& lease) {
    {
      std::lock_guard lock(mutex_);
      task_ = lease.spec().task();
      attempt_ = lease.attempt();
    }
    const std::string kind = lease.spec().kind();
    if (fleet_.arguments.work_s <= 0) return Report(kind);
    const double work_s = fleet_.arguments.work_s * std::uniform_real_distribution(0.5, 1.5)(random_);
    fleet_.timers.At(Now() + std::chrono::microseconds(static_cast<int64_t>(1e6 * work_s)),
                     [this, kind] { Report(kind); });
  }

  void Report(const std::string& kind) {
    auto* call = new Call<v1::ReportTaskRequest, v1::ReportTaskResponse>(*this);
    call->request.set_worker(name_);
    call->request.set_task(task_);
    call->request.set_attempt(attempt_);
    call->request.set_lease_call(lease_call_);
    v1::TaskResult& result = *call->request.mutable_success();
    const std::vector<std::string> names = kind == kIngestKind ? std::vector<std::string>{kSurveyFile, kPlainSurveyFile}
                                           : kind == kPublishKind ? std::vector<std::string>{kMeshFile}
                                                                  : std::vector<std::string>{kStateFile};
    for (const std::string& name : names) {
      v1::OutputFile& output = *result.add_outputs();
      output.set_name(name);
      output.mutable_digest()->set_sha256(fleet_.output.sha256);
      output.mutable_digest()->set_size_bytes(fleet_.output.size_bytes);
    }
    std::string stats = "{\"seconds\":0.01,\"x\":\"";
    stats.resize(298, 'x');
    result.set_stats_json(stats + "\"}");
    result.mutable_usage()->set_core_seconds(0.01);
    const SteadyTime start = Now();
    ++fleet_.calls;
    stub_->async()->ReportTask(&call->context, &call->request, &call->response,
                               [this, call, start](grpc::Status status) {
                                 if (!status.ok()) ++fleet_.errors;
                                 fleet_.reports.Add(1e3 * SecondsSince(start));
                                 {
                                   std::lock_guard lock(mutex_);
                                   task_.clear();
                                 }
                                 if (status.ok() && call->response.has_lease()) {
                                   ++lease_call_;
                                   DoTask(call->response.lease());
                                 } else {
                                   Lease();
                                 }
                                 delete call;
                                 --fleet_.calls;
                               });
  }

  void Heartbeat() {
    if (fleet_.stop) return;
    auto* call = new Call<v1::HeartbeatRequest, v1::HeartbeatResponse>(*this);
    call->request.set_worker(name_);
    {
      std::lock_guard lock(mutex_);
      if (!task_.empty()) {
        v1::TaskProgress& progress = *call->request.add_tasks();
        progress.set_task(task_);
        progress.set_attempt(attempt_);
        progress.set_progress(0.5);
      }
    }
    const SteadyTime start = Now();
    ++fleet_.calls;
    stub_->async()->Heartbeat(&call->context, &call->request, &call->response,
                              [this, call, start](grpc::Status status) {
                                if (!status.ok()) ++fleet_.errors;
                                fleet_.heartbeats.Add(1e3 * SecondsSince(start));
                                fleet_.timers.At(start + std::chrono::milliseconds(1000), [this] { Heartbeat(); });
                                delete call;
                                --fleet_.calls;
                              });
  }

  Fleet& fleet_;
  std::unique_ptr<v1::Workers::Stub> stub_;
  std::string name_, secret_;
  std::mutex mutex_;
  std::string task_;
  int attempt_ = 0;
  int64_t lease_call_ = 1;  // the same until it is answered
  bool has_leased_ = false;
  std::minstd_rand random_;
};

// Runs until the address file is taken away.
int Work(const FleetArguments& arguments, const std::string& folder, const std::string& address_file) {
  std::string address;
  while (address.empty()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    address = ReadFile(address_file).value_or("");
  }
  Fleet fleet;
  fleet.arguments = arguments;
  fleet.output = {Sha256Hex("survey"), 6};
  const std::string ca = arguments.tls ? ReadFile(folder + "/ca.pem").value_or("") : "";
  if (arguments.tls) fleet.token = ReadSecretFile(folder + "/worker.token").value_or("");
  std::vector<std::unique_ptr<FleetWorker>> workers;
  for (int i = 0; i < arguments.workers; ++i) {
    workers.push_back(std::make_unique<FleetWorker>(fleet, address, ca, i));
    if (const Status status = workers.back()->Register("host" + std::to_string(i / 10)); !status.ok()) {
      std::fprintf(stderr, "cannot register: %s\n", std::string(status.message()).c_str());
      return 1;
    }
  }
  for (const auto& worker : workers) worker->Start();
  while (FileExists(address_file)) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  fleet.stop = true;
  fleet.leases.Print("leases");
  fleet.reports.Print("reports");
  fleet.heartbeats.Print("heartbeats");
  std::printf("calls that failed: %d\n", fleet.errors.load());
  std::fflush(stdout);
  _exit(0);  // calls may be under way still
}

StatusOr<double> Serve(const FleetArguments& arguments, const std::string& folder, const std::string& state,
                       const Files& files) {
  TESSERA_RETURN_IF_ERROR(SetUpLog("off", false));
  ChainPlanner planner(arguments);
  TESSERA_ASSIGN_OR_RETURN(const auto served,
                           BenchCoordinator::Start(folder, &planner, /*shared_storage=*/false, arguments.tls, state));
  TESSERA_RETURN_IF_ERROR(served->blobs().PutBytes("survey").status());
  std::unique_ptr<HttpServer> http;
  if (arguments.pages > 0) {
    HttpOptions page;
    page.address = "127.0.0.1:0";
    TESSERA_ASSIGN_OR_RETURN(http, HttpServer::Start(page, &served->server()));
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(files.page_address, http->address()));
  }
  PageTurns turns(files.open_pages);
  Coordinator& coordinator = served->coordinator();
  std::thread ticker([&] {
    while (!coordinator.core().stopped()) {
      coordinator.Tick().IgnoreError();
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    }
  });
  const double before = ResidentBytes();
  NewJob job;
  job.scene_path = "/scene";
  TESSERA_ASSIGN_OR_RETURN(JobStatus status, coordinator.jobs().CreateJob(job));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(files.address, served->address()));
  SteadyTime start = Now();
  double planned_s = 0, most_bytes = 0, start_cpu_s = 0;
  while (!HasEnded(status.header.state) && status.tasks_done < arguments.tasks + 1) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    TESSERA_ASSIGN_OR_RETURN(status, coordinator.jobs().GetJob(status.header.name));
    if (planned_s == 0 && status.tasks_total > arguments.tasks) {
      planned_s = SecondsSince(start);
      start = Now();
      start_cpu_s = CpuSeconds(RUSAGE_SELF);
    }
    if (planned_s > 0 && http != nullptr) turns.Step(status.tasks_done, CpuSeconds(RUSAGE_SELF));
    most_bytes = std::max(most_bytes, ResidentBytes());
  }
  turns.End();
  const double run_s = SecondsSince(start), cpu_s = CpuSeconds(RUSAGE_SELF) - start_cpu_s;
  while (!HasEnded(status.header.state)) {  // published, and the report is written
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    TESSERA_ASSIGN_OR_RETURN(status, coordinator.jobs().GetJob(status.header.name));
    most_bytes = std::max(most_bytes, ResidentBytes());
  }
  const double end_s = SecondsSince(start);
  for (const std::string& file : {files.address, files.page_address}) TESSERA_RETURN_IF_ERROR(RemoveTree(file));
  while (wait(nullptr) > 0) {
  }
  std::printf("%d tasks, %d workers: planned in %.1f s, run in %.1f s: %.0f tasks a second; ended %.1f s later\n",
              arguments.tasks, arguments.workers, planned_s, run_s, arguments.tasks / run_s, end_s - run_s);
  std::printf("processor time a task: coordinator %.2f ms, fleet %.2f ms\n", 1e3 * cpu_s / arguments.tasks,
              1e3 * CpuSeconds(RUSAGE_CHILDREN) / arguments.tasks);
  std::printf("memory at most: %.0f bytes a task\n", (most_bytes - before) / arguments.tasks);
  coordinator.core().Stop();
  ticker.join();
  if (status.header.state != JobState::kSucceeded) return absl::InternalError(status.header.error);
  return arguments.tasks / run_s;
}

}  // namespace

double CpuSeconds(int who) {
  rusage usage = {};
  getrusage(who, &usage);
  const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * t.tv_usec; };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

StatusOr<double> RunFleet(const FleetArguments& arguments, const std::string& folder, const std::string& state) {
  const Files files = {folder + "/address", folder + "/page_address", folder + "/open_pages"};
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  if (fork() == 0) _exit(Work(arguments, folder, files.address));
  if (arguments.pages > 0 && fork() == 0) {
    RunPageClients(arguments.pages, arguments.workers, "jobs/1", files.page_address, files.open_pages);
    _exit(0);
  }
  return Serve(arguments, folder, state, files);
}

Status ReopenFleet(const std::string& folder) {
  SystemClock clock;
  Planner planner;
  const SteadyTime start = Now();
  TESSERA_ASSIGN_OR_RETURN(const auto store, SqliteStore::Open(folder + "/state.sqlite"));
  const double opened_s = SecondsSince(start);
  TESSERA_ASSIGN_OR_RETURN(const auto blobs, FolderBlobs::Open(folder + "/blobs"));
  TESSERA_ASSIGN_OR_RETURN(
      const auto coordinator,
      Coordinator::Open({store.get(), blobs.get(), &planner, &clock, /*on_change=*/{}}, DispatchOptions()));
  std::printf("restart: %.2f s, of which the database %.2f s; %.0f MiB\n", SecondsSince(start), opened_s,
              ResidentBytes() / (1 << 20));
  return absl::OkStatus();
}

}  // namespace tessera

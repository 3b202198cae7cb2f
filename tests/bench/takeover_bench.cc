// takeover_bench --state postgresql://... --folder DIR [--tasks 100000]: how long a cluster has no coordinator. Fills a
// state with a job whose tasks are half done, starts two real coordinators on it, and measures from the end of the
// active one, by SIGKILL and by SIGTERM, to the first lease that a waiting worker gets from the other.
#include <grpcpp/grpcpp.h>
#include <signal.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <latch>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/clock.h"
#include "common/base/version.h"
#include "common/log/log.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/jobs/coordinator.h"
#include "server/ledger/record_owner.h"
#include "server/store/state_store.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/e2e/coordinator_pair.h"

namespace tessera {
namespace {

constexpr int kFillers = 256;  // workers that fill the state

double Seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

// Ingest, then `count` tasks that are ready at once, and publish.
class FlatPlanner : public Planner {
 public:
  explicit FlatPlanner(int count) : count_(count) {}
  StatusOr<std::vector<PlannedTask>> Ingest(const JobSettings&, const std::vector<std::string>&,
                                            const std::vector<int64_t>&) override {
    return std::vector<PlannedTask>{{kIngestKind, "ingest", -1, "{}", 1, {}}};
  }
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings&, const std::string&, const std::vector<std::string>&,
                                           const UpdateBase*, const FinePart*) override {
    std::vector<PlannedTask> tasks;
    PlannedTask publish{kPublishKind, "publish", -1, "{}", 1, {}};
    for (int tile = 0; tile < count_; ++tile) {
      std::string parameters = "{\"tile\":" + std::to_string(tile) + ",\"x\":\"";
      parameters.resize(398, 'x');
      tasks.push_back(
          {"solve", "solve tile " + std::to_string(tile), tile, parameters + "\"}", 0.01, {{TaskId(0), kSurveyFile}}});
      publish.inputs.push_back({TaskId(1 + tile), kStateFile, tile});
    }
    tasks.push_back(std::move(publish));
    return tasks;
  }

 private:
  const int count_;
};

// Leases and reports tasks until `left` is used up. Calls go on from their answers. `ingested`: the first task is done.
class Filler {
 public:
  Filler(Coordinator& coordinator, const Digest& output, std::atomic<int>& left, std::latch& ingested, std::latch& done)
      : coordinator_(coordinator), output_(output), left_(left), ingested_(ingested), done_(done) {
    worker_ = coordinator.leases().RegisterWorker({"host", 1, 1, int64_t{1} << 34, 0, "host/boot"}).value();
  }
  void Lease() {
    coordinator_.leases().LeaseTask({worker_, 20, ++call_, {}, [this](LeaseAnswer answer) {
                                       if (!answer.ok() || !*answer || --left_ < 0) return done_.count_down();
                                       Report(**answer);
                                       Lease();
                                     }});
  }

 private:
  void Report(const GrantedLease& lease) {
    ReportedResult result;
    const bool ingest = lease.plan.kind == kIngestKind;
    result.outputs.push_back({ingest ? kSurveyFile : kStateFile, output_});
    if (ingest) result.outputs.push_back({kPlainSurveyFile, output_});
    result.stats = "{\"seconds\":0.01,\"x\":\"";
    result.stats.resize(298, 'x');
    result.stats += "\"}";
    coordinator_.leases().HandleSuccess(worker_, lease.task, lease.attempt, result).IgnoreError();
    if (ingest) ingested_.count_down();
  }
  Coordinator& coordinator_;
  const Digest output_;
  std::atomic<int>& left_;
  std::latch& ingested_;
  std::latch& done_;
  std::string worker_;
  int64_t call_ = 0;
};

Status Fill(const std::string& state, const std::string& blob_folder, int tasks) {
  TESSERA_ASSIGN_OR_RETURN(const auto store, OpenState(state, {.owner_of = OwnerOfRecord, .holder = "bench"}));
  TESSERA_ASSIGN_OR_RETURN(const auto blobs, FolderBlobs::Open(blob_folder));
  TESSERA_ASSIGN_OR_RETURN(const Digest output, blobs->PutBytes("survey"));
  SystemClock clock;
  FlatPlanner planner(tasks);
  TESSERA_ASSIGN_OR_RETURN(const auto coordinator,
                           Coordinator::Open({store.get(), blobs.get(), &planner, &clock, /*on_change=*/{}}, {}));
  NewJob job;
  job.scene_path = "/scene";
  TESSERA_ASSIGN_OR_RETURN(const JobStatus status, coordinator->jobs().CreateJob(job));
  const double start_s = Seconds();
  std::atomic<int> left = 1 + tasks / 2;
  std::latch ingested(1), done(kFillers);
  std::vector<std::unique_ptr<Filler>> fillers;
  for (int i = 0; i < kFillers; ++i)
    fillers.push_back(std::make_unique<Filler>(*coordinator, output, left, ingested, done));
  for (const auto& filler : fillers) filler->Lease();
  ingested.wait();
  TESSERA_RETURN_IF_ERROR(coordinator->planning().Advance());  // waits for the journal, so not in a call's answer
  done.wait();
  TESSERA_RETURN_IF_ERROR(coordinator->core().Durable());
  TESSERA_ASSIGN_OR_RETURN(const JobStatus filled, coordinator->jobs().GetJob(status.header.name));
  std::printf("state: %d tasks, %d done; filled in %.1f s\n", filled.tasks_total, filled.tasks_done,
              Seconds() - start_s);
  std::fflush(stdout);
  return absl::OkStatus();
}

// A worker as tessera-worker is: waits at most 1 s before it calls again.
class WaitingWorker {
 public:
  explicit WaitingWorker(const std::string& coordinators)
      : stub_(v1::Workers::NewStub(OpenChannel(coordinators, identity_).value())) {}
  // Asks until it gets a lease of the coordinator whose address the call's peer is.
  void AwaitLease(const std::string& from) {
    for (double pause_s = 0.1;; pause_s = std::min(2 * pause_s, 1.0)) {
      if (name_.empty()) Register();
      grpc::ClientContext context;
      SetDeadline(context, 30);
      v1::LeaseTaskRequest request;
      request.set_worker(name_);
      request.set_wait_s(20);
      request.set_call(call_);
      v1::LeaseTaskResponse response;
      const grpc::Status status = stub_->LeaseTask(&context, request, &response);
      if (status.ok()) ++call_;
      if (status.ok() && response.has_lease() && context.peer().ends_with(from)) return;
      if (status.error_code() == grpc::StatusCode::NOT_FOUND ||
          status.error_code() == grpc::StatusCode::PERMISSION_DENIED) {
        name_.clear();
      }
      if (!status.ok()) std::this_thread::sleep_for(std::chrono::duration<double>(pause_s));
    }
  }

 private:
  void Register() {
    grpc::ClientContext context;
    SetDeadline(context, 10);
    v1::RegisterWorkerRequest request;
    request.set_host("host");
    request.set_threads(1);
    request.set_version(kAlgorithmVersion);
    v1::RegisterWorkerResponse response;
    if (!stub_->RegisterWorker(&context, request, &response).ok()) return;
    name_ = response.worker();
    identity_->SetWorker(name_, response.secret());
  }
  const std::shared_ptr<CallIdentity> identity_ = std::make_shared<CallIdentity>();
  std::unique_ptr<v1::Workers::Stub> stub_;
  std::string name_;
  int64_t call_ = 1;
};

Status Run(const std::string& database, const std::string& folder, int tasks, int rounds) {
  TESSERA_RETURN_IF_ERROR(SetUpLog("off", false));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  const std::string state =
      database + "?options=-csearch_path%3Dtakeover_bench_" + std::to_string(std::random_device()());
  e2e::CoordinatorPair pair(folder, state, {"--scene-root", "/", "--log-level", "warn"});
  TESSERA_RETURN_IF_ERROR(Fill(state, pair.blobs(), tasks));
  int active = 0;
  pair.Start(active);
  if (!pair.AwaitActive(active)) return absl::InternalError(pair.program(active).Output());
  WaitingWorker worker(pair.addresses());
  for (int round = 0; round < rounds; ++round) {
    for (const auto& [signal, name] : {std::pair(SIGKILL, "SIGKILL"), std::pair(SIGTERM, "SIGTERM")}) {
      const int standby = 1 - active;
      pair.Start(standby);
      std::this_thread::sleep_for(std::chrono::seconds(1));  // it waits by then
      worker.AwaitLease(pair.address(active));
      const double start_s = Seconds();
      pair.program(active).Signal(signal);
      if (!pair.AwaitActive(standby)) return absl::InternalError(pair.program(standby).Output());
      const double listens_s = Seconds() - start_s;
      worker.AwaitLease(pair.address(standby));
      std::printf("%s: the standby listens after %.1f s, first lease after %.1f s\n", name, listens_s,
                  Seconds() - start_s);
      std::fflush(stdout);
      pair.program(active).Wait();
      active = standby;
    }
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  std::string state, folder;
  int tasks = 100'000, rounds = 3;
  CLI::App app("How long a cluster has no coordinator when a standby takes over");
  app.add_option("--state", state, "postgresql://HOST/DATABASE; a schema of its own is made in it, and stays")
      ->required();
  app.add_option("--folder", folder, "for the coordinators' data and logs, and the blobs; stays")->required();
  app.add_option("--tasks", tasks)->capture_default_str();
  app.add_option("--rounds", rounds)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Run(state, folder, tasks, rounds);
  if (status.ok()) return 0;
  std::fprintf(stderr, "takeover_bench: %s\n", std::string(status.message()).c_str());
  return 1;
}

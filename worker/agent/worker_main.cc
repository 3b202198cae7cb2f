// `tessera-worker`: runs tasks of a coordinator.
#include <pthread.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <thread>

#include "common/access/secrets.h"
#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "common/base/task_usage.h"
#include "common/base/version.h"
#include "common/log/log.h"
#include "common/storage/files.h"
#include "worker/agent/agent.h"
#include "worker/tasks/task.h"

namespace {

// Share of a worker's memory that may stay with the process when it is free.
constexpr int64_t kFreeShare = 8, kMostFree_bytes = int64_t{1} << 30;

struct Flags {
  tessera::Endpoint coordinator = tessera::DefaultAddress();
  std::string work_dir;
  int threads = 0;
  int64_t memory_bytes = 0;
  bool no_shared_storage = false;
  double cache_gib = 20;
  bool exit_with_parent = false;
  double drain_s = 0, idle_s = 0, time_left_s = 0;
  std::string allocation;
  std::string log_level = "info";
  bool json_logs = false;
};

void AddFlags(CLI::App& app, Flags& flags) {
  app.add_option(
         "--coordinator", flags.coordinator.address,
         "Address of the coordinator, HOST:PORT or unix:PATH; a list HOST:PORT,HOST:PORT of those that take over "
         "from each other")
      ->envname("TESSERA_COORDINATOR")
      ->capture_default_str();
  app.add_option("--tls-ca", flags.coordinator.tls_ca,
                 "Certificate authority of the coordinator, PEM; without it the connection does not use TLS")
      ->envname("TESSERA_TLS_CA")
      ->type_name("FILE");
  app.add_option("--tls-cert", flags.coordinator.tls_cert,
                 "Certificate of the worker, PEM, if the coordinator requires one")
      ->envname("TESSERA_TLS_CERT")
      ->type_name("FILE");
  app.add_option("--tls-key", flags.coordinator.tls_key, "Key of the worker's certificate, PEM")
      ->envname("TESSERA_TLS_KEY")
      ->type_name("FILE");
  app.add_option("--token-file", flags.coordinator.token_file,
                 "File with the worker's token; read again when it changes")
      ->envname("TESSERA_TOKEN_FILE")
      ->type_name("FILE");
  app.add_option("--s3-ca", flags.coordinator.store_ca,
                 "Certificate authorities of the coordinator's S3 store, PEM, if it has one (default: the system's)")
      ->envname("AWS_CA_BUNDLE")
      ->type_name("FILE");
  app.add_option("--work", flags.work_dir,
                 "Folder for cache and scratch files, accessible to this user only, kept at exit. "
                 "Default: a temporary folder, removed at exit");
  app.add_option(
         "--threads", flags.threads,
         "Largest number of threads of a task; the coordinator divides a machine's cores between its workers; 0: "
         "one per core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_option("--memory", flags.memory_bytes,
                 "Memory limit, if lower than that of the machine and its control groups")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/true))
      ->type_name("BYTES|MiB|GiB");
  app.add_flag("--no-shared-storage", flags.no_shared_storage,
               "Transfer all data through the blob service; never access the coordinator's folders");
  app.add_option("--cache-gib", flags.cache_gib,
                 "Size limit of the cache of fetched files, GiB; the least recently used are removed first")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option(
         "--drain-s", flags.drain_s,
         "Drain time after SIGTERM or SIGINT, seconds: lease no task, finish the running one or return it to the "
         "queue; a second signal stops at once")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  app.add_option("--allocation", flags.allocation,
                 "Allocation of this worker on a host that a scheduler shares out: workers of one allocation share its "
                 "cores")
      ->envname("SLURM_JOB_ID")
      ->type_name("NAME");
  app.add_option(
         "--idle-s", flags.idle_s,
         "End with exit code 0 after this time without a task, seconds, so that a scheduler such as Slurm can use "
         "the cores for others; 0: never")
      ->check(CLI::Range(0.0, 1e9))
      ->capture_default_str();
  app.add_option("--time-left", flags.time_left_s,
                 "Time until a scheduler ends this worker, seconds: it gets only tasks that are predicted to end 30 s "
                 "before, and "
                 "ends with exit code 0 when 30 s are left; 0: no limit")
      ->check(CLI::Range(0.0, 1e9))
      ->capture_default_str();
  app.add_flag("--exit-with-parent", flags.exit_with_parent, "Drain when the process that started this one ends");
  app.add_option("--log-level", flags.log_level, "Smallest level to log: debug, info, warn, error or off")
      ->capture_default_str();
  app.add_flag("--json-logs", flags.json_logs, "Log one JSON object per line");
}

std::string HostName() {
  char name[256] = {};
  return gethostname(name, sizeof(name) - 1) == 0 ? name : "unknown";
}

// Identifies the machine and its boot, so that a restarted machine of the same name counts as another one, and the
// allocation, because what ends one allocation does not end the others of its host.
std::string Machine(const std::string& allocation) {
  const std::string boot = tessera::ReadFileRange("/proc/sys/kernel/random/boot_id", 0, 8).value_or("");
  return HostName() + "/" + boot + (allocation.empty() ? "" : "/" + allocation);
}

int Fail(const tessera::Status& status) {
  std::fprintf(stderr, "tessera-worker: %s\n", std::string(status.message().data(), status.message().size()).c_str());
  return 1;
}

// The next signal; -1 if there is none within `seconds`. Signals up to two seconds after `first` repeat it: Slurm
// signals all processes of a job, and the job's script passes the signal on.
int NextSignal(const sigset_t& signals, std::chrono::steady_clock::time_point first, double seconds,
               const std::atomic<bool>& ended) {
  using std::chrono::steady_clock;
  const auto end = steady_clock::now() + std::chrono::duration<double>(seconds);
  while (true) {
    const double left_s = std::max(0.0, std::chrono::duration<double>(end - steady_clock::now()).count());
    const auto whole_s = static_cast<time_t>(left_s);
    const timespec wait = {whole_s, static_cast<long>((left_s - static_cast<double>(whole_s)) * 1e9)};
    const int signal = sigtimedwait(&signals, nullptr, &wait);
    if (signal < 0 && errno == EINTR) continue;
    if (signal < 0 || ended || steady_clock::now() - first > std::chrono::seconds(2)) return signal;
  }
}

// First signal: drain, and abort the current task after `drain_s`. Second signal: exit at once. Returns at the next
// signal once `ended` is set.
void HandleSignals(const sigset_t& signals, double drain_s, tessera::Agent& agent, const std::atomic<bool>& ended) {
  constexpr double kNoLimit_s = 1e9;
  int signal = 0;
  sigwait(&signals, &signal);
  if (ended) return;
  const auto first = std::chrono::steady_clock::now();
  tessera::LogInfo("draining", {{"signal", std::to_string(signal)}, {"seconds", std::to_string(drain_s)}});
  agent.StopLeasing();
  signal = NextSignal(signals, first, drain_s, ended);
  if (signal < 0) {
    agent.Drain();
    signal = NextSignal(signals, first, kNoLimit_s, ended);
  }
  if (!ended) _exit(128 + signal);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Run tasks of a Tessera coordinator");
  app.footer("Example:\n  tessera-worker --coordinator city-server:7575 --work /scratch/tessera");
  app.name("tessera-worker");
  app.set_version_flag("--version", TESSERA_VERSION);
  Flags flags;
  AddFlags(app, flags);
  CLI11_PARSE(app, argc, argv);

  // One thread handles the signals; all others inherit the block.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  if (flags.exit_with_parent) {
    const pid_t parent = getppid();
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) return 1;  // the parent has ended meanwhile
  }
  tessera::DisableCoreDumps();  // a core dump would contain the worker's secret
  umask(S_IRWXG | S_IRWXO);
  if (const auto status = tessera::SetUpLog(flags.log_level, flags.json_logs); !status.ok()) return Fail(status);

  std::optional<tessera::TempFolder> own_folder;
  if (flags.work_dir.empty()) {
    auto folder = tessera::TempFolder::Create("", "tessera-worker-");
    if (!folder.ok()) return Fail(folder.status());
    own_folder = *std::move(folder);
    flags.work_dir = own_folder->path();
  }
  tessera::SetMemoryLimit(flags.memory_bytes);
  tessera::KeepFreedMemory(std::min(tessera::MemoryLimit_bytes() / kFreeShare, kMostFree_bytes));
  tessera::AgentOptions options;
  options.coordinator = flags.coordinator;
  options.work_dir = std::filesystem::absolute(flags.work_dir).string();
  options.use_shared_storage = !flags.no_shared_storage;
  options.idle_s = flags.idle_s;
  options.cache_bytes = static_cast<int64_t>(flags.cache_gib * (int64_t{1} << 30));
  options.description = {HostName(),
                         getpid(),
                         flags.threads > 0 ? flags.threads : tessera::CoreLimit(),
                         tessera::MemoryLimit_bytes(),
                         tessera::kAlgorithmVersion,
                         tessera::CoreLimit(),
                         Machine(flags.allocation),
                         flags.allocation,
                         flags.time_left_s};
  options.retry.seed = static_cast<uint64_t>(getpid());
  // Another coordinator of a list may have taken over at any time.
  if (tessera::IsAddressList(flags.coordinator.address)) options.retry.max_delay_s = 1;

  const tessera::ThreadLimit thread_limit(options.description.threads);
  const auto agent = tessera::Agent::Create(options, tessera::RunTask);
  if (!agent.ok()) return Fail(agent.status());
  std::atomic<bool> ended = false;
  std::thread handler([&] { HandleSignals(signals, flags.drain_s, **agent, ended); });
  const tessera::Status status = (*agent)->Run();
  // Wait for the signal thread before the agent is destroyed.
  ended = true;
  pthread_kill(handler.native_handle(), SIGTERM);
  handler.join();
  return status.ok() ? 0 : Fail(status);
}

// `tessera fleet`: submits workers as jobs of a scheduler.
#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "common/base/clock.h"
#include "common/log/log.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/interrupt.h"
#include "server/fleet/ask_coordinator.h"
#include "server/fleet/fleet.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/fleet_status.h"
#include "server/fleet/scheduler.h"

namespace tessera {
namespace {

constexpr double kSleepStep_s = 0.1;
constexpr double kKeptLogs_s = 14 * 86400;

struct FleetFlags {
  Endpoint coordinator;
  std::string file, state;
  bool once = false, status = false, json = false;
  std::string log_level = "info";
  bool json_logs = false;
};

// $XDG_STATE_HOME/tessera/fleet or ~/.local/state/tessera/fleet; empty if HOME is not set.
std::string DefaultStateFolder() {
  const char* const state = std::getenv("XDG_STATE_HOME");
  if (state != nullptr && *state == '/') return absl::StrCat(state, "/tessera/fleet");
  const char* const home = std::getenv("HOME");
  return home == nullptr ? "" : absl::StrCat(home, "/.local/state/tessera/fleet");
}

// Outputs of pilots that nobody needs any more.
void RemoveOldLogs(const std::string& folder, double now_s) {
  const auto names = ListFiles(folder);
  if (!names.ok()) return;
  for (const std::string& name : *names) {
    const std::string path = folder + "/" + name;
    const auto stamp = StampOf(path);
    if (!name.starts_with("tessera.") || !stamp.ok()) continue;
    if (now_s - static_cast<double>(stamp->modified_ns) * 1e-9 > kKeptLogs_s) std::filesystem::remove(path);
  }
}

StatusOr<int> ShowStatus(Fleet& fleet, const FleetFile& file, CoordinatorLink& link, bool json, double now_s) {
  TESSERA_ASSIGN_OR_RETURN(const FleetView view, fleet.Look());
  std::vector<std::string> tasks;
  for (const FleetWorker& worker : view.coordinator.workers) {
    tasks.insert(tasks.end(), worker.tasks.begin(), worker.tasks.end());
  }
  const auto titles = link.Titles(tasks);
  const std::string text =
      json ? FleetStatusJson(file, view, titles, now_s) : FleetStatusText(file, view, titles, now_s);
  std::fputs(text.c_str(), stdout);
  return kExitOk;
}

// Rounds until the first signal.
void RunRounds(Fleet& fleet, double interval_s) {
  while (Interrupts() == 0) {
    (void)fleet.Round();  // its error is reported
    for (double waited_s = 0; waited_s < interval_s && Interrupts() == 0; waited_s += kSleepStep_s) {
      RealSleeper()(kSleepStep_s);
    }
  }
}

StatusOr<int> RunFleet(FleetFlags flags) {
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(flags.file, kMaxFleetFileBytes));
  TESSERA_ASSIGN_OR_RETURN(FleetFile file, ParseFleetFile(flags.file, text));
  TESSERA_RETURN_IF_ERROR(SetUpLog(flags.log_level, flags.json_logs));
  if (flags.state.empty()) return absl::InvalidArgumentError("HOME is not set; give the state folder with --state");
  const std::string folder = AbsolutePath(flags.state + "/" + file.name);
  if (file.logs.empty()) file.logs = folder + "/logs";
  const SystemClock clock;
  const auto now_s = [&] { return static_cast<double>(clock.UnixTimeUs()) * 1e-6; };
  CoordinatorLink link(file, flags.coordinator);
  CommandScheduler scheduler(file, Interrupts);
  FleetParts parts;
  parts.ask_coordinator = [&] { return link.Ask(); };
  parts.scheduler = &scheduler;
  parts.clock = &clock;
  parts.backoff_path = folder + "/backoff.json";
  parts.notify = [&](const FleetMessage& message) {
    if (!flags.status) LogInfo(message.text, {{"fleet", file.name}, {"about", message.subject}});
  };
  if (flags.status) {
    Fleet fleet(file, text, std::move(parts));
    return ShowStatus(fleet, file, link, flags.json, now_s());
  }
  TESSERA_RETURN_IF_ERROR(EnsurePrivateFolder(folder));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(file.logs));
  const auto lock = FileLock::Acquire(folder + "/lock");
  if (!lock.ok()) {
    return absl::FailedPreconditionError(absl::StrCat("another `tessera fleet` with the name '", file.name,
                                                      "' is running: ", std::string(lock.status().message())));
  }
  InstallInterruptCounter();
  RemoveOldLogs(file.logs, now_s());
  Fleet fleet(file, text, std::move(parts));
  if (flags.once) {
    TESSERA_RETURN_IF_ERROR(fleet.Round());
    return kExitOk;
  }
  LogInfo("fleet started", {{"fleet", file.name}, {"state", folder}, {"coordinator", flags.coordinator.address}});
  RunRounds(fleet, file.interval_s);
  LogInfo("fleet stopped; pilots go on and end when they are idle", {{"fleet", file.name}});
  return kExitOk;
}

}  // namespace

void AddFleetCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<FleetFlags>();
  CLI::App* command = app.add_subcommand("fleet", "Submit workers as jobs of a scheduler such as Slurm");
  command->footer(
      "Runs where the scheduler's commands are, until SIGTERM. Every few seconds it asks the coordinator how many "
      "workers\n"
      "have work, submits pilots (jobs that run one worker each) and cancels pending ones that nobody needs. It never\n"
      "cancels running pilots: they end by `tessera-worker --idle-s`. It needs a viewer's token.\n"
      "FILE (deploy/slurm/README.md describes all fields):\n"
      "  {\"name\": \"city\", \"scheduler\": \"slurm\", \"pilot\": \"/opt/tessera/pilot\",\n"
      "   \"worker\": [\"tessera-worker\", \"--coordinator\", \"login:7575\", \"--idle-s\", \"60\"],\n"
      "   \"classes\": [{\"name\": \"small\", \"memory\": \"4GiB\", \"cores\": 2, \"time_limit_s\": 7200, \"most\": "
      "20}]}\n"
      "Examples:\n"
      "  tessera fleet city.json --coordinator login:7575 --tls-ca ca.pem --token-file vera.token\n"
      "  tessera fleet city.json --once          (for scrontab or cron)\n"
      "  tessera fleet city.json --status");
  flags->state = DefaultStateFolder();
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("FILE", flags->file, "Description of the fleet, JSON")->required();
  CLI::Option* const once = command->add_flag("--once", flags->once, "Do one round and end");
  command->add_flag("--status", flags->status, "Show wanted, running and pending pilots; change nothing")
      ->excludes(once);
  command->add_flag("--json", flags->json, "With --status: print JSON");
  command
      ->add_option("--state", flags->state,
                   "Folder for the fleet's lock, its back-off after failures, and the output of pilots unless FILE "
                   "names another; must be reachable by the compute nodes")
      ->capture_default_str();
  command->add_option("--log-level", flags->log_level, "Smallest level to log: debug, info, warn, error or off")
      ->capture_default_str();
  command->add_flag("--json-logs", flags->json_logs, "Log one JSON object per line");
  SetAction(command, exit_code, [flags] { return RunFleet(*flags); });
}

}  // namespace tessera

#include "server/fleet/scheduler.h"

#include <unistd.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "server/fleet/job_list.h"
#include "server/fleet/run_command.h"

namespace tessera {

CommandScheduler::CommandScheduler(const FleetFile& fleet, std::function<int()> interrupts)
    : fleet_(fleet), interrupts_(std::move(interrupts)) {}

StatusOr<std::string> CommandScheduler::Run(const std::vector<std::string>& words, int most_interrupts) {
  CommandLimits limits;
  limits.seconds = fleet_.command_s;
  limits.stop = [&] { return interrupts_() > most_interrupts; };
  return RunCommand(words, limits);
}

StatusOr<std::vector<Pilot>> CommandScheduler::List() {
  const int64_t user = ::geteuid();
  TESSERA_ASSIGN_OR_RETURN(const std::string text, Run(ListWords(fleet_, absl::StrCat(user)), 0));
  return fleet_.commands.lists_as_squeue ? ParseSlurmJobs(text, fleet_, user) : ParseJobList(text, fleet_);
}

StatusOr<std::string> CommandScheduler::Submit(const PilotClass& pilots, int count) {
  return Run(SubmitWords(fleet_, pilots, count), 1);
}

Status CommandScheduler::Cancel(const std::vector<std::string>& jobs) {
  return Run(CancelWords(fleet_, jobs), 1).status();
}

}  // namespace tessera

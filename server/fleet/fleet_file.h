// The file that describes a fleet of pilots, for `tessera fleet`.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// A pilot is a job of a scheduler such as Slurm that runs one worker. All pilots of a class are alike.
struct PilotClass {
  std::string name;
  int64_t memory_mib = 0;  // of the job
  int cores = 1;
  double time_limit_s = 0;
  int least = 0, most = 0;           // pilots that are pending or running
  int most_pending = 0;              // pilots that are pending
  std::vector<std::string> options;  // further words of the submit command
};

// The memory that the pilot gives to its worker: that of the job less 5 %, at least 64 MiB, for the pilot itself and
// for what predictions miss. deploy/slurm/pilot computes the same.
int64_t WorkerMemory_mib(const PilotClass& pilots);
// The time that the pilot's worker surely has: the limit in whole minutes, as the scheduler takes it, less a tenth of
// it, at most a minute, in which the worker starts. A task that needs more would be wanted, but no pilot would get it.
double WorkerTime_s(const PilotClass& pilots);

// Commands of a scheduler as lists of words; the first is the program. A word may contain placeholders such as {count}.
struct SchedulerCommands {
  std::vector<std::string> submit, list, cancel;
  bool lists_as_squeue = false;  // the output of `list` is that of `squeue --json`; else as in ParseJobList
};

struct FleetFile {
  std::string name;
  SchedulerCommands commands;
  std::string pilot;                                     // script of the jobs
  std::vector<std::string> worker = {"tessera-worker"};  // command line of the worker
  std::vector<std::string> options;                      // further words of the submit command
  std::string logs;                                      // folder for the output of pilots; empty: in the state folder
  double worth_s = 300;                                  // work that each pilot should have, seconds
  double interval_s = 10;                                // between two rounds
  double command_s = 60;                                 // time limit of a command
  std::vector<PilotClass> classes;                       // of ascending memory
};

inline constexpr int64_t kMaxFleetFileBytes = 1 << 20;

// INVALID_ARGUMENT with every fault, its place and what was expected. `path`: for errors.
StatusOr<FleetFile> ParseFleetFile(const std::string& path, const std::string& text);

// The scheduler's name for the jobs of a class: "tessera.NAME.CLASS".
std::string JobName(const FleetFile& fleet, const PilotClass& pilots);

// The words of a command with each placeholder replaced. A placeholder {worker}, {options} or {jobs} must be a word of
// its own and becomes any number of words.
std::vector<std::string> SubmitWords(const FleetFile& fleet, const PilotClass& pilots, int count);
std::vector<std::string> ListWords(const FleetFile& fleet, const std::string& user);
std::vector<std::string> CancelWords(const FleetFile& fleet, const std::vector<std::string>& jobs);

}  // namespace tessera

// Jobs that users submit to a soaked cluster, and the expected outcome of each.
#pragma once

#include <functional>
#include <list>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "tests/e2e/programs.h"
#include "tests/e2e/record_audit.h"
#include "tests/soak/soaked_cluster.h"

namespace tessera::soak {

// Over all clusters.
struct Tally {
  std::map<std::string, int> faults, commands, jobs, failures;
  int files = 0, records = 0, answers = 0;
  int64_t bytes = 0;
  double longest_end_s = 0;                  // from the end of all faults to that of the last job
  double longest_answer_s = 0;               // of `tessera jobs` while the coordinator is well
  int refused_starts = 0, replacements = 0;  // see SoakedCluster
};

// What is asked for: a scene with settings.
struct Errand {
  const char* name;
  std::function<std::string()> scene;
  std::vector<std::string> arguments;
  int base = -1;  // place of the errand whose result it goes on from
};
const std::vector<Errand>& Errands();

class SoakedJobs {
 public:
  // All must outlive it.
  SoakedJobs(SoakedCluster& cluster, uint64_t seed, History& history, Tally& tally);

  // What a user does next, by chance.
  void Act();
  // Looks at what has been answered. Throws Violation.
  void Supervise();
  // For when all faults are over: every paused job goes on, every failed one is tried again. Whether all have ended.
  bool BringToEnd();
  // Fetches what every job published and compares it with what an undisturbed job makes. Throws Violation.
  void Compare();
  // Holds what is stored against what was told. Throws Violation.
  void CheckRecords(const e2e::RecordAudit& audit);
  // What is not as it should be yet.
  std::string Waiting() const;

 private:
  static constexpr double kNever = 1e300;
  struct Job {
    int errand = 0;
    std::string request_id;
    std::string base;    // name of a job
    std::string name;    // once it is known
    int submitting = 0;  // commands on their way
    bool cancel_asked = false;
    double cancelled_s = kNever;  // when it was told to be
    bool retry_asked = false;     // since it was last seen to have failed
    std::string state = "";       // JOB_..., as last told
    std::string error;
    std::string files;  // what it published
    bool paused = false;
    bool ended() const;
  };
  struct Command {
    std::unique_ptr<e2e::Program> program;
    std::string words;
    double start_s = 0;
    std::function<void(const e2e::Outcome&)> done;
  };

  void Run(const std::vector<std::string>& arguments, std::function<void(const e2e::Outcome&)> done);
  void Submit(Job& job);
  void NewJob();
  // As it was asked for at `asked_s`.
  void TakeList(const nlohmann::json& list, double asked_s);
  void TakeState(Job& job, const nlohmann::json& told, double asked_s);
  void DeleteJobs();
  // Some known job; null if there is none.
  Job* Any();

  SoakedCluster& cluster_;
  const uint64_t seed_;
  int acts_ = 0;
  Random random_{0};  // of what is done now
  History& history_;
  Tally& tally_;
  std::list<Job> jobs_;
  std::list<Command> commands_;
  bool looking_ = false;
  double look_s_ = 0;
};

}  // namespace tessera::soak

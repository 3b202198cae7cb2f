#include "tests/soak/soaked_jobs.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "common/storage/files.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera::soak {
namespace {

namespace fs = std::filesystem;
using e2e::Outcome;
using nlohmann::json;

constexpr size_t kMaxUnfinished = 3;  // jobs at a time
constexpr double kLook_s = 0.5;       // between two looks at all jobs
constexpr double kCalm_s = 3;         // after which a coordinator is expected to answer
constexpr double kAnswer_s = 60;      // within which, on a busy machine
constexpr double kFetch_s = 120;      // in which a published file that was lost is made again

std::vector<std::string> Meshes(const std::string& folder) {
  std::vector<std::string> meshes;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".ply") continue;
    if (const std::string name = fs::relative(entry.path(), folder); !name.starts_with(".")) meshes.push_back(name);
  }
  std::sort(meshes.begin(), meshes.end());
  return meshes;
}

std::string ResultOf(int errand) {
  const Errand& asked = Errands()[errand];
  return e2e::UndisturbedResult(asked.scene(), asked.arguments, asked.base < 0 ? "" : ResultOf(asked.base));
}

// What may fail a task when workers and files are lost again and again.
bool IsBySoak(const std::string& error) {
  return error.find("(poison") != std::string::npos || error.find("workers on live machines") != std::string::npos ||
         error.find("and lost every time") != std::string::npos;
}

}  // namespace

const std::vector<Errand>& Errands() {
  static const std::vector<Errand> errands = {
      {"four tiles", e2e::ToyCity, {"--tiles", "4"}},
      {"untiled", e2e::ToyCity, {"--tiles", "1", "--levels", "1,0", "--iterations", "2,2"}},
      {"baseline", e2e::ToyCity, {"--tiles", "2", "--method", "baseline", "--levels", "1", "--iterations", "4"}},
      {"nine tiles", e2e::ToyCity, {"--tiles", "9", "--levels", "1", "--iterations", "3", "--semantic", "0.2"}},
      {"street", e2e::Street, {"--tiles", "8", "--levels", "1", "--iterations", "3"}},
      {"flight", e2e::NextFlight, {}, 4},
  };
  return errands;
}

bool SoakedJobs::Job::ended() const {
  return !state.empty() && state != "JOB_STATE_QUEUED" && state != "JOB_STATE_RUNNING";
}

SoakedJobs::SoakedJobs(SoakedCluster& cluster, uint64_t seed, History& history, Tally& tally)
    : cluster_(cluster), seed_(seed), history_(history), tally_(tally) {}

void SoakedJobs::Run(const std::vector<std::string>& arguments, std::function<void(const Outcome&)> done) {
  Command command;
  for (const std::string& word : arguments) command.words += (command.words.empty() ? "" : " ") + word;
  std::vector<std::string> all = arguments;
  all.insert(all.end(), {"--coordinator", cluster_.address()});
  command.program = std::make_unique<e2e::Program>(cluster_.folder() + "/commands", TESSERA_PROGRAM, all);
  command.start_s = history_.Now_s();
  command.done = std::move(done);
  ++tally_.commands[arguments.front()];
  commands_.push_back(std::move(command));
}

void SoakedJobs::Submit(Job& job) {
  const Errand& errand = Errands()[job.errand];
  std::vector<std::string> words = {errand.base < 0 ? "submit" : "update", errand.scene(), "--request-id",
                                    job.request_id};
  words.insert(words.end(), errand.arguments.begin(), errand.arguments.end());
  if (errand.base >= 0) words.insert(words.end(), {"--base", job.base});
  ++job.submitting;
  Run(words, [this, &job](const Outcome& outcome) {
    --job.submitting;
    if (outcome.exit_code != 0) {
      if (outcome.exit_code != 1 && outcome.exit_code != 4) {
        throw Violation("a job was refused: " + outcome.output);
      }
      return;  // BringToEnd submits it again
    }
    const size_t at = outcome.output.rfind("jobs/");
    const std::string name = outcome.output.substr(at, outcome.output.find('\n', at) - at);
    if (!job.name.empty() && job.name != name) {
      throw Violation("one request is two jobs: " + job.name + " and " + name);
    }
    job.name = name;
    history_.Note(name + " accepted: " + Errands()[job.errand].name + ", request " + job.request_id);
  });
}

void SoakedJobs::NewJob() {
  Job job;
  job.errand = static_cast<int>(random_.Below(static_cast<int64_t>(Errands().size())));
  const bool twice = random_.Below(3) == 0;
  if (const int base = Errands()[job.errand].base; base >= 0) {
    const auto done = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& each) {
      return each.errand == base && each.state == "JOB_STATE_SUCCEEDED";
    });
    if (done == jobs_.end()) {
      job.errand = base;
    } else {
      job.base = done->name;
    }
  }
  job.request_id = "request-" + std::to_string(jobs_.size() + 1);
  jobs_.push_back(std::move(job));
  Submit(jobs_.back());
  if (twice) Submit(jobs_.back());
}

SoakedJobs::Job* SoakedJobs::Any() {
  const double place = random_.Uniform();
  std::vector<Job*> known;
  for (Job& job : jobs_) {
    if (!job.name.empty()) known.push_back(&job);
  }
  return known.empty() ? nullptr : known[static_cast<size_t>(place * static_cast<double>(known.size()))];
}

void SoakedJobs::Act() {
  random_ = RandomOf(seed_, 'j', acts_++);
  const int64_t which = random_.Below(10);
  const auto unfinished = std::count_if(jobs_.begin(), jobs_.end(), [](const Job& job) { return !job.ended(); });
  if (which < 5 || jobs_.empty()) {
    if (static_cast<size_t>(unfinished) < kMaxUnfinished) NewJob();
    return;
  }
  Job* const job = Any();
  if (job == nullptr) return;
  const auto nothing = [](const Outcome&) {};
  switch (which) {
    case 5:
      history_.Note("cancel " + job->name);
      job->cancel_asked = true;
      return Run({"cancel", job->name}, [this, job](const Outcome& outcome) {
        if (outcome.output.find(" cancelled\n") == std::string::npos) return;
        job->cancelled_s = std::min(job->cancelled_s, history_.Now_s());
      });
    case 6:
      history_.Note("pause " + job->name);
      return Run({"pause", job->name}, nothing);
    case 7:
      return Run({"resume", job->name}, nothing);
    case 8:
      return Run({"priority", job->name, std::to_string(random_.Below(20))}, nothing);
    default:
      job->retry_asked = true;
      return Run({"retry", job->name}, nothing);
  }
}

void SoakedJobs::Supervise() {
  for (auto command = commands_.begin(); command != commands_.end();) {
    if (command->program->Running()) {
      ++command;
      continue;
    }
    const auto done = std::move(command->done);
    const Outcome outcome = command->program->Wait();
    commands_.erase(command++);
    done(outcome);
  }
  DeleteJobs();
}

void SoakedJobs::DeleteJobs() {
  if (looking_ || history_.Now_s() < look_s_) return;
  looking_ = true;
  const double start_s = history_.Now_s();
  std::set<std::string> expected;
  for (const Job& job : jobs_) {
    if (!job.name.empty()) expected.insert(job.name);
  }
  Run({"jobs", "--json", "--count", "1000"}, [this, start_s, expected](const Outcome& outcome) {
    looking_ = false;
    const double now_s = history_.Now_s();
    look_s_ = now_s + kLook_s;
    if (cluster_.CalmSince_s() + kCalm_s < start_s) {
      if (outcome.exit_code != 0 || now_s - start_s > kAnswer_s) {
        throw Violation("`tessera jobs` had no good answer after " + std::to_string(now_s - start_s) +
                        " s, though the coordinator was well: " + outcome.output);
      }
      tally_.longest_answer_s = std::max(tally_.longest_answer_s, now_s - start_s);
    }
    if (outcome.exit_code != 0) return;
    const json list = json::parse(outcome.output, nullptr, false);
    if (!list.is_object()) throw Violation("`tessera jobs --json` printed " + outcome.output);
    ++tally_.answers;
    TakeList(list, start_s);
    for (const std::string& name : expected) {
      if (outcome.output.find("\"" + name + "\"") == std::string::npos) throw Violation(name + " is lost");
    }
  });
}

void SoakedJobs::TakeList(const json& list, double asked_s) {
  for (const json& told : list.value("jobs", json::array())) {
    const auto job =
        std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& each) { return each.name == told.value("name", ""); });
    if (job != jobs_.end()) TakeState(*job, told, asked_s);
  }
}

void SoakedJobs::TakeState(Job& job, const json& told, double asked_s) {
  const std::string state = told.value("state", ""), files = told.value("artifacts", json::array()).dump();
  const bool had_ended = job.ended(), may_go_on = job.state == "JOB_STATE_FAILED" || job.state == "JOB_STATE_PARTIAL";
  if (had_ended && (state != job.state || files != job.files) && !may_go_on) {
    throw Violation(job.name + " had ended as " + job.state + " and is " + state + " now, with " +
                    (files == job.files ? "the same files" : "other files"));
  }
  if (job.cancelled_s < asked_s && state != "JOB_STATE_CANCELLED")
    throw Violation(job.name + " was cancelled and is " + state);
  job.paused = told.value("paused", false);
  job.error = told.value("error", "");
  job.files = files;
  if (std::exchange(job.state, state) == state) return;
  history_.Note(job.name + " is " + state + (job.error.empty() ? "" : ": " + job.error));
  if (!job.ended()) return;
  job.retry_asked = false;
  if (state == "JOB_STATE_CANCELLED" && !job.cancel_asked) throw Violation(job.name + " was cancelled by nobody");
  if ((state == "JOB_STATE_FAILED" || state == "JOB_STATE_PARTIAL") && !IsBySoak(job.error)) {
    throw Violation(job.name + " is " + state + ": " + job.error);
  }
  ++tally_.jobs[state];
}

bool SoakedJobs::BringToEnd() {
  bool all = true;
  for (Job& job : jobs_) {
    if (job.name.empty()) {
      if (job.submitting == 0) Submit(job);
    } else if (job.paused && !job.ended()) {
      job.paused = false;  // until it is told again
      Run({"resume", job.name}, [](const Outcome&) {});
    } else if ((job.state == "JOB_STATE_FAILED" || job.state == "JOB_STATE_PARTIAL") && !job.retry_asked) {
      job.retry_asked = true;
      history_.Note("retry " + job.name);
      Run({"retry", job.name}, [](const Outcome&) {});
    }
    all = all && (job.state == "JOB_STATE_SUCCEEDED" || job.state == "JOB_STATE_CANCELLED");
  }
  // What was asked before may still change something.
  return all && std::all_of(commands_.begin(), commands_.end(),
                            [](const Command& command) { return command.words.starts_with("jobs"); });
}

std::string SoakedJobs::Waiting() const {
  std::string words;
  for (const Job& job : jobs_) {
    if (job.state == "JOB_STATE_SUCCEEDED" || job.state == "JOB_STATE_CANCELLED") continue;
    words += "\n  " + (job.name.empty() ? job.request_id + " without a name" : job.name + " " + job.state) + " (" +
             Errands()[job.errand].name + ")";
  }
  for (const Command& command : commands_) words += "\n  tessera " + command.words;
  return words;
}

void SoakedJobs::Compare() {
  for (const Job& job : jobs_) {
    if (job.state != "JOB_STATE_SUCCEEDED") continue;
    const std::string out = cluster_.folder() + "/fetched";
    fs::remove_all(out);
    Outcome fetched;
    const bool came = e2e::WaitUntil(
        [&] {
          cluster_.Supervise();
          fetched = e2e::Tessera(cluster_.folder() + "/commands",
                                 {"fetch", job.name, "--out", out, "--coordinator", cluster_.address()});
          return fetched.exit_code == 0;
        },
        kFetch_s);
    if (!came) throw Violation(job.name + " cannot be fetched: " + fetched.output);
    const std::string undisturbed = ResultOf(job.errand);
    const std::vector<std::string> meshes = Meshes(undisturbed);
    if (meshes.empty() || Meshes(out) != meshes) throw Violation(job.name + " has not the files that it should have");
    for (const std::string& mesh : meshes) {
      const std::string content = e2e::Content(out + "/" + mesh);
      if (content != e2e::Content(undisturbed + "/" + mesh)) {
        throw Violation(job.name + " (" + Errands()[job.errand].name + "): " + mesh +
                        " is not what an undisturbed job makes; fetched to " + out);
      }
      ++tally_.files;
      tally_.bytes += static_cast<int64_t>(content.size());
    }
  }
}

void SoakedJobs::CheckRecords(const e2e::RecordAudit& audit) {
  std::string faults;
  for (const std::string& fault : audit.faults()) faults += "\n  " + fault;
  if (!faults.empty()) throw Violation("the stored records cannot be:" + faults);
  for (const auto& [name, stored] : audit.jobs()) {
    const auto job = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& each) { return each.name == name; });
    if (job == jobs_.end()) throw Violation(name + " was accepted and nobody knows of it");
    if (job->request_id != stored.request_id) throw Violation(name + " is of request " + stored.request_id);
    if (v1::JobState_Name(static_cast<v1::JobState>(stored.state)) != job->state) {
      throw Violation(name + " was told to be " + job->state + " and is stored as " + std::to_string(stored.state));
    }
  }
  if (audit.jobs().size() != jobs_.size()) throw Violation("a job that was accepted is not stored");
  tally_.records += audit.records();
  for (const auto& [kind, errors] : audit.failures()) {
    tally_.failures[kind] += static_cast<int>(errors.size());
    for (const std::string& error : errors) history_.Note("an attempt failed (" + kind + "): " + error);
  }
}

}  // namespace tessera::soak

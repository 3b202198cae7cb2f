#include "server/fleet/fleet.h"

#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "server/client/child_process.h"

namespace tessera {
namespace {

constexpr int64_t kMaxBackoffBytes = 64 << 20;
constexpr int kOutputLines = 5;

std::string PilotLines(const std::string& output) {
  if (output.empty()) return "";
  return FileExists(output) ? LastLines(output, kOutputLines)
                            : absl::StrCat("its output cannot be read here: ", output);
}

}  // namespace

Fleet::Fleet(const FleetFile& file, const std::string& file_text, FleetParts parts)
    : file_(file), parts_(std::move(parts)), file_hash_(Sha256Hex(file_text)) {
  if (!FileExists(parts_.backoff_path)) {
    backoff_.file = file_hash_;
    return;
  }
  const auto text = ReadFile(parts_.backoff_path, kMaxBackoffBytes);
  auto read = text.ok() ? ParseBackoff(*text) : StatusOr<FleetBackoff>(text.status());
  if (read.ok()) {
    backoff_ = *std::move(read);
  } else {
    NotifyError("back-off", absl::InvalidArgumentError(absl::StrCat(
                                parts_.backoff_path,
                                " is damaged; an empty back-off is used: ", std::string(read.status().message()))));
  }
  if (backoff_.file == file_hash_) return;
  // Somebody may have repaired what made pilots fail.
  backoff_.file = file_hash_;
  backoff_.classes.clear();
  for (auto& [job, pilot] : backoff_.pilots) pilot.judged = true;
}

double Fleet::Now_s() const { return static_cast<double>(parts_.clock->UnixTimeUs()) * 1e-6; }

void Fleet::Notify(const std::vector<FleetMessage>& messages) {
  std::set<std::string> subjects;
  for (const FleetMessage& message : messages) {
    subjects.insert(message.subject);
    if (std::exchange(notified_[message.subject], message.text) != message.text) parts_.notify(message);
  }
  for (auto& [subject, text] : notified_) {
    if (subjects.contains(subject) || text.empty()) continue;
    parts_.notify({subject, absl::StrCat("no longer: ", text.substr(0, text.find('\n')))});
    text.clear();
  }
}

void Fleet::NotifyError(const std::string& subject, const Status& status) {
  const std::string text(status.message());
  if (std::exchange(notified_[subject], text) != text) parts_.notify({subject, text});
}

Status Fleet::Update(FleetView* view) {
  auto coordinator = parts_.ask_coordinator();
  if (!coordinator.ok()) {
    NotifyError("coordinator", coordinator.status());
    return coordinator.status();
  }
  view->coordinator = *std::move(coordinator);
  auto pilots = parts_.scheduler->List();
  if (!pilots.ok()) {
    NotifyError("list", pilots.status());
    return pilots.status();
  }
  view->pilots = *std::move(pilots);
  std::set<std::string> allocations;
  for (const FleetWorker& worker : view->coordinator.workers) allocations.insert(worker.allocation);
  JudgePilots(file_, view->pilots, allocations, Now_s(), PilotLines, &backoff_);
  view->plan = PlanFleet(file_, view->coordinator.demand, view->pilots, view->coordinator.workers, backoff_, Now_s());
  return absl::OkStatus();
}

StatusOr<FleetView> Fleet::Look() {
  FleetView view;
  TESSERA_RETURN_IF_ERROR(Update(&view));
  return view;
}

// Submits pilots of the largest class that lacks some and was not yet `submitted` in this round; false if there is none
// or the answer was lost.
bool Fleet::SubmitOne(const FleetPlan& plan, std::vector<bool>* submitted) {
  for (size_t c = plan.classes.size(); c-- > 0;) {
    const int count = plan.classes[c].submit;
    if (count == 0 || (*submitted)[c]) continue;
    (*submitted)[c] = true;
    const PilotClass& pilots = file_.classes[c];
    const auto answer = parts_.scheduler->Submit(pilots, count);
    if (answer.ok()) {
      CountSubmit(file_, static_cast<int>(c), count, Now_s(), &backoff_);
      const std::string first_line = answer->substr(0, answer->find('\n'));
      parts_.notify({"submit", absl::StrCat("submitted ", count, " pilots of class ", pilots.name,
                                            first_line.empty() ? "" : ": ", first_line)});
    } else {
      const std::string why(answer.status().message());
      CountLostSubmit(file_, static_cast<int>(c), why, Now_s(), &backoff_);
      parts_.notify({"submit", absl::StrCat("submitting ", count, " pilots of class ", pilots.name, " failed: ", why)});
    }
    Store();
    return answer.ok();
  }
  return false;
}

void Fleet::CancelPending(const FleetPlan& plan) {
  std::vector<std::string> jobs;
  for (const ClassPlan& pilots : plan.classes) jobs.insert(jobs.end(), pilots.cancel.begin(), pilots.cancel.end());
  if (jobs.empty()) return;
  for (const std::string& job : jobs) backoff_.pilots[job].judged = true;
  const Status cancelled = parts_.scheduler->Cancel(jobs);
  parts_.notify({"cancel", cancelled.ok() ? absl::StrCat("cancelled ", jobs.size(), " pending pilots")
                                          : absl::StrCat("cancelling ", jobs.size(), " pending pilots failed: ",
                                                         std::string(cancelled.message()))});
}

void Fleet::Store() {
  std::string text = BackoffText(backoff_);
  if (text == stored_) return;
  const Status written = WriteFileAtomic(parts_.backoff_path, text);
  if (!written.ok()) return NotifyError("back-off", written);
  stored_ = std::move(text);
}

Status Fleet::Round() {
  std::vector<bool> submitted(file_.classes.size());
  FleetView view;
  do {
    TESSERA_RETURN_IF_ERROR(Update(&view));
  } while (SubmitOne(view.plan, &submitted));
  Notify(view.plan.messages);
  CancelPending(view.plan);
  Store();
  return absl::OkStatus();
}

}  // namespace tessera

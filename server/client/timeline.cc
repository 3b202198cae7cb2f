#include "server/client/timeline.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/storage/files.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/tasks.pb.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

int64_t Micros(const google::protobuf::Timestamp& time) { return time.seconds() * 1'000'000 + time.nanos() / 1000; }

std::string OutcomeName(const v1::Attempt& attempt) {
  if (attempt.outcome() == v1::ATTEMPT_OUTCOME_FAILED) {
    return EnumWords(v1::ErrorClass_Name(attempt.error().error_class()), "ERROR_CLASS_");
  }
  return EnumWords(v1::AttemptOutcome_Name(attempt.outcome()), "ATTEMPT_OUTCOME_");
}

bool HasFailed(const v1::Attempt& attempt) {
  return attempt.outcome() == v1::ATTEMPT_OUTCOME_FAILED || attempt.outcome() == v1::ATTEMPT_OUTCOME_LEASE_EXPIRED;
}

// The name of a process or of a thread of it.
Json NameEvent(const char* what, int process, int row, const std::string& name) {
  return {{"name", what}, {"ph", "M"}, {"pid", process}, {"tid", row}, {"args", {{"name", name}}}};
}

Json SliceEvent(const v1::Attempt& attempt, int process, int row, int64_t start_us, int64_t duration_us) {
  const std::string outcome = OutcomeName(attempt);
  const bool succeeded = attempt.outcome() == v1::ATTEMPT_OUTCOME_SUCCEEDED, failed = HasFailed(attempt);
  Json event = {{"name", succeeded ? attempt.title() : attempt.title() + " (" + outcome + ")"},
                {"ph", "X"},
                {"pid", process},
                {"tid", row},
                {"cat", failed ? attempt.kind() + ",failed" : attempt.kind()}};
  if (!succeeded) event["cname"] = failed ? "terrible" : "grey";
  event["ts"] = start_us;
  event["dur"] = duration_us;
  event["args"] = {{"task", attempt.task()},
                   {"kind", attempt.kind()},
                   {"tile", attempt.tile()},
                   {"attempt", attempt.attempt()},
                   {"outcome", outcome}};
  if (!attempt.error().message().empty()) event["args"]["error"] = attempt.error().message();
  return event;
}

// On one line; names may not be UTF-8.
std::string LineOf(const Json& json) {
  return json.dump(-1, ' ', /*ensure_ascii=*/true, Json::error_handler_t::replace);
}

struct Row {
  int number = 0;
  int64_t end_us = 0;  // of its last slice
};

}  // namespace

std::string TimelineJson(const v1::Job& job, std::vector<v1::Attempt> attempts, int64_t now_us) {
  std::stable_sort(attempts.begin(), attempts.end(), [](const v1::Attempt& a, const v1::Attempt& b) {
    return Micros(a.start_time()) < Micros(b.start_time());
  });
  const int64_t zero_us = Micros(job.create_time());
  const int64_t last_us = job.has_end_time() ? Micros(job.end_time()) : now_us;
  std::vector<std::string> events;
  std::map<std::string, int> process_of_machine;
  std::map<std::pair<int, std::string>, std::vector<Row>> rows_of_worker;
  int rows = 0;
  for (const v1::Attempt& attempt : attempts) {
    const auto [process, new_process] =
        process_of_machine.insert({attempt.machine(), static_cast<int>(process_of_machine.size()) + 1});
    if (new_process) {
      events.push_back(LineOf(
          NameEvent("process_name", process->second, 0, attempt.machine().empty() ? "machine" : attempt.machine())));
    }
    const int64_t start_us = Micros(attempt.start_time());
    const int64_t end_us = std::max(start_us, attempt.has_end_time() ? Micros(attempt.end_time()) : last_us);
    std::vector<Row>& of_worker = rows_of_worker[{process->second, attempt.worker()}];
    auto row =
        std::find_if(of_worker.begin(), of_worker.end(), [&](const Row& each) { return each.end_us <= start_us; });
    if (row == of_worker.end()) {
      row = of_worker.insert(row, Row{++rows});
      const std::string further = of_worker.size() > 1 ? " (" + std::to_string(of_worker.size()) + ")" : "";
      events.push_back(LineOf(NameEvent("thread_name", process->second, row->number, attempt.worker() + further)));
    }
    row->end_us = end_us;
    events.push_back(LineOf(SliceEvent(attempt, process->second, row->number, start_us - zero_us, end_us - start_us)));
  }
  const Json about = {{"job", job.name()}, {"name", job.display_name()}, {"state", JobStateName(job.state())}};
  return absl::StrCat("{\"displayTimeUnit\":\"ms\",\"otherData\":", LineOf(about), ",\n\"traceEvents\":[",
                      events.empty() ? "" : "\n", absl::StrJoin(events, ",\n"), "\n]}\n");
}

Status WriteTimeline(Connection& connection, const std::string& name, const Clock& clock, const std::string& path) {
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection.GetJob(name, &job));
  v1::ListAttemptsResponse list;
  TESSERA_RETURN_IF_ERROR(connection.ListAttempts(name, &list));
  return WriteFileAtomic(path, TimelineJson(job, {list.attempts().begin(), list.attempts().end()}, clock.UnixTimeUs()));
}

}  // namespace tessera

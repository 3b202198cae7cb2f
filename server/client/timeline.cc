#include "server/client/timeline.h"

#include <algorithm>
#include <cctype>
#include <map>
#include <string_view>
#include <utility>

#include "common/base/printable.h"
#include "common/storage/files.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/tasks.pb.h"

namespace tessera {
namespace {

int64_t Micros(const google::protobuf::Timestamp& time) { return time.seconds() * 1'000'000 + time.nanos() / 1000; }

// "lost input" for ERROR_CLASS_LOST_INPUT.
std::string ErrorName(const v1::TaskError& error) {
  std::string word = v1::ErrorClass_Name(error.error_class());
  if (constexpr std::string_view kType = "ERROR_CLASS_"; word.starts_with(kType)) word.erase(0, kType.size());
  for (char& c : word) c = c == '_' ? ' ' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return word;
}

std::string OutcomeName(const v1::Attempt& attempt) {
  switch (attempt.outcome()) {
    case v1::ATTEMPT_OUTCOME_RUNNING:
      return "running";
    case v1::ATTEMPT_OUTCOME_SUCCEEDED:
      return "succeeded";
    case v1::ATTEMPT_OUTCOME_FAILED:
      return ErrorName(attempt.error());
    case v1::ATTEMPT_OUTCOME_LEASE_EXPIRED:
      return "lease expired";
    case v1::ATTEMPT_OUTCOME_CANCELLED:
      return "cancelled";
    default:
      return "unknown";
  }
}

bool HasFailed(const v1::Attempt& attempt) {
  return attempt.outcome() == v1::ATTEMPT_OUTCOME_FAILED || attempt.outcome() == v1::ATTEMPT_OUTCOME_LEASE_EXPIRED;
}

// Builds the trace event by event.
class Trace {
 public:
  void Name(const char* what, int process, int row, const std::string& name) {
    Begin(what, "M", process, row);
    text_ += R"(,"args":{"name":)" + JsonQuoted(name) + "}}";
  }

  void Slice(const v1::Attempt& attempt, int process, int row, int64_t start_us, int64_t duration_us) {
    const std::string outcome = OutcomeName(attempt);
    const bool succeeded = attempt.outcome() == v1::ATTEMPT_OUTCOME_SUCCEEDED;
    Begin(succeeded ? attempt.title() : attempt.title() + " (" + outcome + ")", "X", process, row);
    Add("cat", HasFailed(attempt) ? attempt.kind() + ",failed" : attempt.kind());
    if (!succeeded) Add("cname", HasFailed(attempt) ? "terrible" : "grey");
    text_ += R"(,"ts":)" + std::to_string(start_us) + R"(,"dur":)" + std::to_string(duration_us);
    text_ += R"(,"args":{"task":)" + JsonQuoted(attempt.task());
    Add("kind", attempt.kind());
    text_ += R"(,"tile":)" + std::to_string(attempt.tile()) + R"(,"attempt":)" + std::to_string(attempt.attempt());
    Add("outcome", outcome);
    if (!attempt.error().message().empty()) Add("error", attempt.error().message());
    text_ += "}}";
  }

  const std::string& text() const { return text_; }

 private:
  void Begin(const std::string& name, const char* phase, int process, int row) {
    text_ += text_.empty() ? "\n" : ",\n";
    text_ += R"({"name":)" + JsonQuoted(name);
    Add("ph", phase);
    text_ += R"(,"pid":)" + std::to_string(process) + R"(,"tid":)" + std::to_string(row);
  }
  void Add(const char* key, const std::string& value) {
    text_.append(",\"").append(key).append("\":").append(JsonQuoted(value));
  }
  std::string text_;
};

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
  Trace trace;
  std::map<std::string, int> process_of_machine;
  std::map<std::pair<int, std::string>, std::vector<Row>> rows_of_worker;
  int rows = 0;
  for (const v1::Attempt& attempt : attempts) {
    const auto [process, new_process] =
        process_of_machine.insert({attempt.machine(), static_cast<int>(process_of_machine.size()) + 1});
    if (new_process) {
      trace.Name("process_name", process->second, 0, attempt.machine().empty() ? "machine" : attempt.machine());
    }
    const int64_t start_us = Micros(attempt.start_time());
    const int64_t end_us = std::max(start_us, attempt.has_end_time() ? Micros(attempt.end_time()) : last_us);
    std::vector<Row>& of_worker = rows_of_worker[{process->second, attempt.worker()}];
    auto row =
        std::find_if(of_worker.begin(), of_worker.end(), [&](const Row& each) { return each.end_us <= start_us; });
    if (row == of_worker.end()) {
      row = of_worker.insert(row, Row{++rows});
      const std::string further = of_worker.size() > 1 ? " (" + std::to_string(of_worker.size()) + ")" : "";
      trace.Name("thread_name", process->second, row->number, attempt.worker() + further);
    }
    row->end_us = end_us;
    trace.Slice(attempt, process->second, row->number, start_us - zero_us, end_us - start_us);
  }
  std::string text = R"({"displayTimeUnit":"ms","otherData":{"job":)" + JsonQuoted(job.name());
  text += R"(,"name":)" + JsonQuoted(job.display_name());
  text += R"(,"state":)" + JsonQuoted(JobStateName(job.state())) + "},\n\"traceEvents\":[";
  return text + trace.text() + "\n]}\n";
}

Status WriteTimeline(Connection& connection, const std::string& name, const Clock& clock, const std::string& path) {
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection.GetJob(name, &job));
  std::vector<v1::Attempt> attempts;
  TESSERA_RETURN_IF_ERROR(connection.ListAttempts(name, &attempts));
  return WriteFileAtomic(path, TimelineJson(job, std::move(attempts), clock.UnixTimeUs()));
}

}  // namespace tessera

#include "server/client/job_text.h"

#include <algorithm>
#include <cmath>

#include "tessera/v1/jobs.pb.h"

namespace tessera {

std::string JobStateName(int state) {
  switch (state) {
    case v1::JOB_STATE_QUEUED:
      return "queued";
    case v1::JOB_STATE_RUNNING:
      return "running";
    case v1::JOB_STATE_SUCCEEDED:
      return "succeeded";
    case v1::JOB_STATE_FAILED:
      return "failed";
    case v1::JOB_STATE_PARTIAL:
      return "partial";
    case v1::JOB_STATE_CANCELLED:
      return "cancelled";
    default:
      return "unknown";
  }
}

std::string JobStatusName(const v1::Job& job) {
  return job.paused() && !HasEnded(job.state()) ? "paused" : JobStateName(job.state());
}

bool HasEnded(int state) {
  return HasResult(state) || state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED;
}

bool HasResult(int state) { return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_PARTIAL; }

std::string FullJobName(const std::string& given) { return given.rfind("jobs/", 0) == 0 ? given : "jobs/" + given; }

std::string FormatDuration(double seconds) {
  const long long whole = std::llround(std::clamp(seconds, 0.0, 1e9));
  if (whole < 60) return std::to_string(whole) + " s";
  if (whole < 3600) return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  return std::to_string(whole / 3600) + " h " + std::to_string(whole / 60 % 60) + " min";
}

std::string FormatThousands(long long value) {
  std::string digits = std::to_string(value < 0 ? -value : value);
  for (int i = static_cast<int>(digits.size()) - 3; i > 0; i -= 3) digits.insert(i, 1, ',');
  if (value < 0) digits.insert(0, 1, '-');
  return digits;
}

}  // namespace tessera

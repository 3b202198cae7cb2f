#include "server/client/job_text.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {

std::string EnumWords(const std::string& name, const std::string& type) {
  const std::string words = absl::StrReplaceAll(absl::AsciiStrToLower(absl::StripPrefix(name, type)), {{"_", " "}});
  return words.empty() ? "unknown" : words;
}

std::string JobStateName(int state) {
  return EnumWords(v1::JobState_Name(static_cast<v1::JobState>(state)), "JOB_STATE_");
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

std::string ColumnsText(const std::vector<std::vector<std::string>>& rows) {
  std::vector<size_t> widths(rows.front().size());
  for (const std::vector<std::string>& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const std::vector<std::string>& row : rows) {
    std::string line;
    for (size_t i = 0; i < row.size(); ++i) line += row[i] + std::string(widths[i] - row[i].size() + 2, ' ');
    text += line.erase(line.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

std::string FormatThousands(long long value) {
  std::string digits = std::to_string(value < 0 ? -value : value);
  for (int i = static_cast<int>(digits.size()) - 3; i > 0; i -= 3) digits.insert(i, 1, ',');
  if (value < 0) digits.insert(0, 1, '-');
  return digits;
}

}  // namespace tessera

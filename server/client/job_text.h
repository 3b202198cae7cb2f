// Names and text of jobs and tasks for people.
#pragma once

#include <string>
#include <vector>

namespace tessera {

namespace v1 {
class Job;
}  // namespace v1

// An enum value's name without its type, in lower case: "lost input" for ERROR_CLASS_LOST_INPUT.
std::string EnumWords(const std::string& name, const std::string& type);

// `state`: a v1::JobState. "running", "succeeded", ...
std::string JobStateName(int state);

// As JobStateName, but "paused" for a paused job that has not ended.
std::string JobStatusName(const v1::Job& job);

// Whether a v1::JobState is final.
bool HasEnded(int state);
// Whether a job in this v1::JobState has a result, complete or without some tiles.
bool HasResult(int state);

// "jobs/3" for "jobs/3" or "3".
std::string FullJobName(const std::string& given);

// "8 s", "3 min 20 s", "2 h 5 min".
std::string FormatDuration(double seconds);

// The rows as lines, their columns as wide as the widest entry, two spaces apart.
std::string ColumnsText(const std::vector<std::vector<std::string>>& rows);

// 1234567 as "1,234,567".
std::string FormatThousands(long long value);

}  // namespace tessera

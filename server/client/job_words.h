// How jobs and tasks are named and shown to people.
#ifndef TESSERA_SERVER_CLIENT_JOB_WORDS_H_
#define TESSERA_SERVER_CLIENT_JOB_WORDS_H_

#include <string>

namespace tessera {

// `state`: v1::JobState, v1::TaskState by number. "running", "succeeded", ...
std::string JobStateWord(int state);
std::string TaskStateWord(int state);

// Whether a v1::JobState is final.
bool HasEnded(int state);

// "jobs/3" of "jobs/3" or "3".
std::string FullJobName(const std::string& given);

// "8 s", "3 min 20 s", "2 h 5 min".
std::string DurationWords(double seconds);

// 1234567 as "1,234,567".
std::string Grouped(long long value);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_JOB_WORDS_H_

// How jobs and tasks are named and shown to people.
#ifndef TESSERA_SERVER_CLIENT_JOB_WORDS_H_
#define TESSERA_SERVER_CLIENT_JOB_WORDS_H_

#include <string>

namespace tessera {

namespace v1 {
class Job;
}  // namespace v1

// `state`: a v1::JobState by number. "running", "succeeded", ...
std::string JobStateWord(int state);

// As JobStateWord, "paused" of a paused job that has not ended.
std::string JobWord(const v1::Job& job);

// Whether a v1::JobState is final.
bool HasEnded(int state);
// Whether a job in this v1::JobState has published one, be it without some tiles.
bool HasResult(int state);

// "jobs/3" of "jobs/3" or "3".
std::string FullJobName(const std::string& given);

// "8 s", "3 min 20 s", "2 h 5 min".
std::string DurationWords(double seconds);

// 1234567 as "1,234,567".
std::string Grouped(long long value);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_JOB_WORDS_H_

// Writes job.json: what a job did, for its user.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "server/ledger/job.h"

namespace tessera {

// JSON with the job, its settings, totals and every task (attempts, workers, seconds, key, statistics). Tasks are
// passed one at a time, because a city has millions: call Count for all, Head, Line for each, Tail. Not thread-safe.
class JobReport {
 public:
  // `end`: final state; `error`: empty if it succeeded; `quarantined`: reason by tile; `end_us`: Unix time of the end.
  JobReport(JobHeader header, JobState end, std::string error, std::map<int, std::string> quarantined, int64_t end_us);
  void Count(const JobTask& task);
  std::string Head() const;
  std::string Line(const JobTask& task);
  static std::string Tail() { return "\n ]\n}\n"; }

 private:
  const JobHeader header_;
  const JobState end_;
  const std::string error_;
  const std::map<int, std::string> quarantined_;
  const int64_t end_us_;
  int64_t tasks_ = 0, attempts_ = 0, reused_ = 0;
  std::map<std::string, double> seconds_of_kind_, seconds_of_stage_, core_seconds_of_kind_, seconds_of_worker_;
  std::map<std::string, int64_t> tasks_of_kind_;
  bool has_line_ = false;
};

}  // namespace tessera

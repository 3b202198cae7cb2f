// Checks the invariants of a coordinator's stored records, independently of the coordinator's code.
#pragma once

#include <map>
#include <string>
#include <vector>

namespace tessera::v1 {
class Record;
}  // namespace tessera::v1

namespace tessera::e2e {

// Receives the records in order. Shares no code with the coordinator's own checks.
class RecordAudit {
 public:
  struct Task {
    int attempts = 0;   // started
    bool runs = false;  // the last attempt has not ended
    bool done = false;  // succeeded, and the result was not lost since
    int successes = 0;
    std::map<std::string, std::string> outputs = {};  // name: SHA-256
  };
  struct Job {
    std::string request_id;
    int state = 0;  // v1::JobState, 0: not ended
    int ends = 0;
    std::map<std::string, Task> tasks = {};  // those that were tried or have a result
    std::map<int, std::string> kinds = {};   // of planned tasks
  };

  void Add(const v1::Record& record);

  const std::map<std::string, Job>& jobs() const { return jobs_; }
  // Violations as text: an attempt that ended twice or never started, two results of one task, two jobs of one request,
  // a change of a job that has ended.
  const std::vector<std::string>& faults() const { return faults_; }
  int records() const { return records_; }
  // Number of failed attempts by error class; "silence" if the lease expired.
  const std::map<std::string, std::vector<std::string>>& failures() const { return failures_; }

 private:
  Task& TaskOf(const std::string& name);
  Job& JobOf(const std::string& task);
  void Fault(const std::string& what);
  void Expect(bool holds, const std::string& what);

  std::map<std::string, Job> jobs_;
  std::map<std::string, std::vector<std::string>> failures_;
  std::vector<std::string> faults_;
  int records_ = 0;
};

// Audits a coordinator's state.sqlite, which must not be in use, or its state in PostgreSQL, as soon as no coordinator
// holds it.
RecordAudit AuditRecords(const std::string& state);

}  // namespace tessera::e2e

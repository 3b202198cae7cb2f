// One job from submission to its files, in a thread of its own, so that the thread which looks after the processes
// never waits for a call.
#ifndef TESSERA_SERVER_CLIENT_LOCAL_JOB_H_
#define TESSERA_SERVER_CLIENT_LOCAL_JOB_H_

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/client/connection.h"

namespace tessera {

// How the job stands. Messages of v1 are held as pointers so that their headers stay out of this one.
struct LocalJobState {
  bool ended = false;  // nothing more will happen
  bool accepted = false;
  Status status;                                       // of the calls; valid once ended
  bool failed_for_input = false;                       // the job failed because its input is wrong
  std::shared_ptr<const v1::Job> job;                  // as last known; null before it was accepted
  std::shared_ptr<const v1::WatchJobResponse> update;  // the last one; null if there is none since the last Wait
  std::vector<std::string> written;                    // paths of the results
};

class LocalJob {
 public:
  // Cancels what an interrupted run left unfinished at this coordinator, submits `request`, follows the job and, if it
  // succeeded, brings its files to `out` by way of `staging`. `timeline`: file for its timeline once it has ended;
  // empty: none.
  LocalJob(std::unique_ptr<Connection> connection, const v1::CreateJobRequest& request, const std::string& out,
           const std::string& staging, const std::string& timeline = "");
  // Breaks off and waits for the thread. The coordinator should have been told or stopped before.
  ~LocalJob();

  // Waits up to `seconds` for something new.
  LocalJobState Wait(double seconds);

  // Cancels the job, as far as the coordinator can still be reached.
  void Cancel();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_LOCAL_JOB_H_

// Runs one job from submission to the download of its files in its own thread, so that the thread that supervises the
// processes never blocks on a call.
#pragma once

#include <memory>
#include <string>

#include "common/base/status.h"
#include "server/client/connection.h"

namespace tessera {

// State of the job. Messages of v1 are held by pointer to keep their headers out of this one.
struct LocalJobState {
  bool ended = false;  // no further change
  bool accepted = false;
  Status status;                                       // of the calls; valid if ended
  bool failed_for_input = false;                       // the job failed because its input is wrong
  std::shared_ptr<const v1::Job> job;                  // as last known; null before it was accepted
  std::shared_ptr<const v1::WatchJobResponse> update;  // the newest update; null if there is none since the last Wait
};

class LocalJob {
 public:
  // Cancels unfinished jobs of an interrupted run at this coordinator, submits `request`, watches the job and, if it
  // has a result, downloads its files to `out` through `staging`. `timeline`: file for the Chrome trace; empty: none.
  LocalJob(std::unique_ptr<Connection> connection, const v1::CreateJobRequest& request, const std::string& out,
           const std::string& staging, const std::string& timeline = "");
  // Aborts the calls and joins the thread. Call Cancel or stop the coordinator first.
  ~LocalJob();

  // Waits up to `seconds` for a change of state.
  LocalJobState Wait(double seconds);

  // Cancels the job, if the coordinator is available.
  void Cancel();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

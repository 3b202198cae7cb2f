#include "server/client/local_job.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "server/client/artifacts.h"
#include "server/client/job_text.h"
#include "server/client/timeline.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {

struct LocalJob::Impl {
  std::unique_ptr<Connection> connection;
  v1::CreateJobRequest request;
  std::string out;
  std::string staging;
  std::string timeline;

  std::atomic<bool> broken_off{false};
  std::mutex mutex;
  std::condition_variable changed;
  bool news = false;
  LocalJobState state;
  std::thread thread;

  template <class Change>
  void Update(const Change& change) {
    {
      std::lock_guard lock(mutex);
      change(state);
      news = true;
    }
    changed.notify_all();
  }

  Status CancelOldJobs() {
    v1::ListJobsResponse jobs;
    TESSERA_RETURN_IF_ERROR(connection->ListJobs(1000, &jobs));
    for (const v1::Job& old : jobs.jobs()) {
      v1::Job cancelled;
      if (!HasEnded(old.state())) TESSERA_RETURN_IF_ERROR(connection->CancelJob(old.name(), &cancelled));
    }
    return absl::OkStatus();
  }

  Status Run() {
    TESSERA_RETURN_IF_ERROR(CancelOldJobs());
    v1::Job job;
    TESSERA_RETURN_IF_ERROR(connection->CreateJob(request, &job));
    Update([&](LocalJobState& to) {
      to.accepted = true;
      to.job = std::make_shared<v1::Job>(job);
    });
    TESSERA_RETURN_IF_ERROR(connection->WatchJob(job.name(), [&](const v1::WatchJobResponse& update) {
      job = update.job();
      Update([&](LocalJobState& to) {
        to.job = std::make_shared<v1::Job>(job);
        to.update = std::make_shared<v1::WatchJobResponse>(update);
      });
    }));
    if (job.state() == v1::JOB_STATE_FAILED) {
      const bool for_input = connection->FailedForInput(job.name());
      Update([&](LocalJobState& to) { to.failed_for_input = for_input; });
    }
    if (!timeline.empty()) {
      TESSERA_RETURN_IF_ERROR(WriteTimeline(*connection, job.name(), SystemClock(), timeline));
    }
    if (!HasResult(job.state())) return absl::OkStatus();
    TESSERA_RETURN_IF_ERROR(TakeArtifacts(*connection, "", &job));
    Update([&](LocalJobState& to) { to.job = std::make_shared<v1::Job>(job); });
    TaskControl control;
    control.cancelled = [this] { return broken_off.load(); };
    return FetchArtifacts(*connection, job, out, staging, control).status();
  }
};

LocalJob::LocalJob(std::unique_ptr<Connection> connection, const v1::CreateJobRequest& request, const std::string& out,
                   const std::string& staging, const std::string& timeline)
    : impl_(std::make_unique<Impl>()) {
  impl_->connection = std::move(connection);
  impl_->request = request;
  impl_->out = out;
  impl_->staging = staging;
  impl_->timeline = timeline;
  impl_->thread = std::thread([impl = impl_.get()] {
    const Status status = impl->Run();
    impl->Update([&](LocalJobState& to) {
      to.status = status;
      to.ended = true;
    });
  });
}

LocalJob::~LocalJob() {
  impl_->broken_off = true;
  impl_->connection->StopWatching();
  impl_->thread.join();
}

LocalJobState LocalJob::Wait(double seconds) {
  std::unique_lock lock(impl_->mutex);
  impl_->changed.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return impl_->news; });
  impl_->news = false;
  LocalJobState state = impl_->state;
  impl_->state.update = nullptr;
  return state;
}

void LocalJob::Cancel() {
  std::string name;
  {
    std::lock_guard lock(impl_->mutex);
    if (impl_->state.job == nullptr || impl_->state.ended) return;
    name = impl_->state.job->name();
  }
  v1::Job job;
  impl_->connection->CancelJob(name, &job).IgnoreError();
}

}  // namespace tessera

// A fake workers service: leases the tasks that a test queues and records the calls.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "common/rpc/channel.h"
#include "tessera/v1/errors.pb.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/support/fake_blob_service.h"

namespace tessera {

inline grpc::Status Refused(grpc::StatusCode code, v1::Refusal::Reason reason) {
  v1::Refusal refusal;
  refusal.set_reason(reason);
  return grpc::Status(code, "told to refuse", refusal.SerializeAsString());
}

class FakeWorkersService : public v1::Workers::Service {
 public:
  FakeWorkersService() { Start(); }
  ~FakeWorkersService() override {
    if (server_ != nullptr) Stop();
  }

  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  FakeBlobService& blobs() { return blobs_; }

  // Away and back, on the same port. Workers registered before are forgotten if `forget`.
  void Stop() {
    {
      std::lock_guard lock(mutex_);
      serving_ = false;
    }
    changed_.notify_all();
    server_->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(100));
    server_->Wait();
    server_.reset();
  }
  void Start(bool forget = false) {
    std::lock_guard lock(mutex_);
    if (forget) workers_.clear();
    serving_ = true;
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:" + std::to_string(port_), grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(this);
    builder.RegisterService(&blobs_);
    builder.SetMaxReceiveMessageSize(16 << 20);
    AllowKeepalive(builder);
    server_ = builder.BuildAndStart();
    port_ = port;
  }

  void Queue(const v1::Lease& lease) {
    std::lock_guard lock(mutex_);
    leases_.push_back(lease);
    changed_.notify_all();
  }
  // Every further heartbeat that names the task is told to stop it.
  void Void(const std::string& task) {
    std::lock_guard lock(mutex_);
    void_.insert(task);
  }
  // The task's report is taken, and its answers are lost until a heartbeat was told that nobody has the task any more.
  void LoseAnswersOf(const std::string& task) {
    std::lock_guard lock(mutex_);
    lost_task_ = task;
  }
  void ShareFolder(const std::string& dir, const std::string& probe_path, const std::string& probe_content) {
    std::lock_guard lock(mutex_);
    shared_blob_dir_ = dir;
    probe_path_ = probe_path;
    probe_content_ = probe_content;
  }
  void AnswerReportsWith(const grpc::Status& status) {
    std::lock_guard lock(mutex_);
    report_answer_ = status;
  }
  // The answer to a success that asks for the next task brings it.
  void BringTasksWithAnswers() {
    std::lock_guard lock(mutex_);
    answers_bring_tasks_ = true;
  }
  // The next `times` calls for a lease.
  void AnswerLeasesWith(const grpc::Status& status, int times) {
    std::lock_guard lock(mutex_);
    lease_answers_.insert(lease_answers_.end(), times, status);
  }
  void AnswerRegistrationsWith(const grpc::Status& status) {
    std::lock_guard lock(mutex_);
    register_answer_ = status;
  }

  // Waits for `condition`, called under the lock with *this; false after 20 s.
  bool WaitFor(const std::function<bool(const FakeWorkersService&)>& condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(20), [&] { return condition(*this); });
  }

  // What was told; read them in WaitFor's condition, or when nothing runs any more.
  std::vector<v1::ReportTaskRequest> reports;
  std::vector<v1::TaskProgress> progress;
  std::vector<std::string> unregistered;
  int registrations = 0;
  double time_left_s = 0;  // of the last registration
  int leases_asked = 0;
  std::vector<int64_t> lease_calls;
  int reports_answered = 0;

  grpc::Status RegisterWorker(grpc::ServerContext*, const v1::RegisterWorkerRequest* request,
                              v1::RegisterWorkerResponse* response) override {
    std::lock_guard lock(mutex_);
    if (!register_answer_.ok()) return register_answer_;
    const std::string name = "workers/" + std::to_string(++registrations);
    workers_.insert(name);
    time_left_s = request->time_left_s();
    response->set_worker(name);
    response->set_lease_s(2);
    response->set_heartbeat_s(0.02);
    response->set_shared_blob_dir(shared_blob_dir_);
    response->set_shared_probe_path(probe_path_);
    response->set_shared_probe_content(probe_content_);
    changed_.notify_all();
    return grpc::Status::OK;
  }

  grpc::Status LeaseTask(grpc::ServerContext* context, const v1::LeaseTaskRequest* request,
                         v1::LeaseTaskResponse* response) override {
    std::unique_lock lock(mutex_);
    ++leases_asked;
    lease_calls.push_back(request->call());
    changed_.notify_all();
    if (!workers_.contains(request->worker())) return Forgotten();
    if (!lease_answers_.empty()) {
      const grpc::Status answer = lease_answers_.front();
      lease_answers_.pop_front();
      return answer;
    }
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(request->wait_s());
    while (leases_.empty() && serving_ && !context->IsCancelled() && std::chrono::steady_clock::now() < deadline) {
      changed_.wait_for(lock, std::chrono::milliseconds(20));
    }
    if (!serving_) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "stopping");
    if (leases_.empty() || context->IsCancelled()) return grpc::Status::OK;
    *response->mutable_lease() = leases_.front();
    leases_.pop_front();
    return grpc::Status::OK;
  }

  grpc::Status Heartbeat(grpc::ServerContext*, const v1::HeartbeatRequest* request,
                         v1::HeartbeatResponse* response) override {
    std::lock_guard lock(mutex_);
    if (!workers_.contains(request->worker())) return Forgotten();
    for (const v1::TaskProgress& task : request->tasks()) {
      progress.push_back(task);
      if (void_.contains(task.task())) response->add_stop_tasks(task.task());
      if (void_.contains(task.task()) && task.task() == lost_task_) lost_task_.clear();
    }
    changed_.notify_all();
    return grpc::Status::OK;
  }

  grpc::Status ReportTask(grpc::ServerContext*, const v1::ReportTaskRequest* request,
                          v1::ReportTaskResponse* response) override {
    std::lock_guard lock(mutex_);
    if (!workers_.contains(request->worker())) return Forgotten();
    reports.push_back(*request);
    changed_.notify_all();
    if (request->task() == lost_task_) {
      void_.insert(lost_task_);
      return grpc::Status(grpc::StatusCode::UNAVAILABLE, "lost");
    }
    ++reports_answered;
    if (answers_bring_tasks_ && request->has_success() && request->lease_call() > 0 && !leases_.empty()) {
      *response->mutable_lease() = leases_.front();
      leases_.pop_front();
    }
    return report_answer_;
  }

  grpc::Status UnregisterWorker(grpc::ServerContext*, const v1::UnregisterWorkerRequest* request,
                                v1::UnregisterWorkerResponse*) override {
    std::lock_guard lock(mutex_);
    unregistered.push_back(request->worker());
    workers_.erase(request->worker());
    changed_.notify_all();
    return grpc::Status::OK;
  }

 private:
  static grpc::Status Forgotten() { return Refused(grpc::StatusCode::NOT_FOUND, v1::Refusal::REASON_UNKNOWN_WORKER); }

  std::mutex mutex_;
  std::condition_variable changed_;
  FakeBlobService blobs_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
  bool serving_ = false;
  std::deque<v1::Lease> leases_;
  std::set<std::string> workers_;
  std::set<std::string> void_;
  std::string lost_task_;
  std::string shared_blob_dir_, probe_path_, probe_content_;
  grpc::Status report_answer_;
  bool answers_bring_tasks_ = false;
  std::deque<grpc::Status> lease_answers_;
  grpc::Status register_answer_;
};

}  // namespace tessera

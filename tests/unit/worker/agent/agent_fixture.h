// An agent and its coordinator in one process.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/log/log.h"
#include "common/storage/files.h"
#include "tests/support/fake_workers_service.h"
#include "worker/agent/agent.h"

namespace tessera {

class AgentTest : public testing::Test {
 protected:
  AgentTest() : folder_(TempFolder::Create(testing::TempDir()).value()) { EXPECT_TRUE(SetUpLog("off", false).ok()); }
  ~AgentTest() override { StopAgent(); }

  // A task that reads "in.txt" and "sub/other.bin", if present, and writes their content to "out.txt".
  static StatusOr<TaskOutcome> Concatenate(const TaskRequest& request, const TaskControl&) {
    std::string content = request.kind + "(" + request.parameters + ")";
    TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListFiles(request.input_dir));
    for (const std::string& name : names) {
      content += name + "=" + ReadFile(request.input_dir + "/" + name).value() + ";";
    }
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(request.output_dir + "/out.txt", content));
    TaskOutcome outcome;
    outcome.outputs = {"out.txt"};
    outcome.stats = "{\"n\":1}";
    outcome.warnings = {"odd \xff byte"};
    return outcome;
  }

  void StartAgent(TaskRunner runner, bool use_shared_storage = true) {
    AgentOptions options;
    options.coordinator = coordinator_.address();
    options.work_dir = folder_.path() + "/work";
    options.use_shared_storage = use_shared_storage;
    options.retry.first_delay_s = 0.01;
    options.retry.max_delay_s = 0.05;
    options.storage_wait_s = 0.5;
    options.idle_s = idle_s_;
    options.description.time_left_s = time_left_s_;
    auto agent = Agent::Create(options, std::move(runner));
    ASSERT_TRUE(agent.ok()) << agent.status();
    agent_ = *std::move(agent);
    thread_ = std::thread([this] { agent_status_ = agent_->Run(); });
  }
  void StopAgent() {
    if (agent_ == nullptr) return;
    agent_->Drain();
    if (thread_.joinable()) thread_.join();
    agent_ = nullptr;
  }

  v1::Lease NewLease(const std::string& task, int attempt = 1) {
    v1::Lease lease;
    lease.set_attempt(attempt);
    lease.mutable_spec()->set_task(task);
    lease.mutable_spec()->set_kind("cut");
    lease.mutable_spec()->set_parameters_json("{}");
    return lease;
  }
  void AddInput(v1::Lease& lease, const std::string& name, const std::string& content,
                const std::string& shared_path = "") {
    AddInput(lease, name, coordinator_.blobs().Add(content), shared_path);
  }
  static void AddInput(v1::Lease& lease, const std::string& name, const Digest& digest,
                       const std::string& shared_path) {
    v1::InputFile* input = lease.mutable_spec()->add_inputs();
    input->set_name(name);
    input->mutable_digest()->set_sha256(digest.sha256);
    input->mutable_digest()->set_size_bytes(digest.size_bytes);
    input->set_shared_path(shared_path);
  }
  v1::ReportTaskRequest WaitForReport(size_t count = 1) {
    EXPECT_TRUE(coordinator_.WaitFor([&](const FakeWorkersService& c) { return c.reports.size() >= count; }));
    StopAgent();
    return coordinator_.reports.empty() ? v1::ReportTaskRequest() : coordinator_.reports.back();
  }
  static Digest DigestOf(const v1::OutputFile& output) {
    return {output.digest().sha256(), output.digest().size_bytes()};
  }

  TempFolder folder_;
  double idle_s_ = 0, time_left_s_ = 0;  // of agents that are started
  FakeWorkersService coordinator_;
  std::unique_ptr<Agent> agent_;
  std::thread thread_;
  Status agent_status_;
};

}  // namespace tessera

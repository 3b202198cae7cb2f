#include "server/client/child_process.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <thread>

#include "common/storage/files.h"

namespace tessera {
namespace {

class ChildProcessTest : public testing::Test {
 protected:
  ChildProcessTest() : folder_(TempFolder::Create(testing::TempDir()).value()), log_(folder_.path() + "/log") {}
  std::unique_ptr<ChildProcess> Shell(const std::string& script) {
    return ChildProcess::Start("/bin/sh", {"-c", script}, log_).value();
  }
  static void Join(ChildProcess& process) {
    while (process.Running()) std::this_thread::yield();
  }

  TempFolder folder_;
  const std::string log_;
};

TEST_F(ChildProcessTest, ReportsExitAndKeepsOutput) {
  const auto process = Shell("echo one; echo two >&2; exit 7");
  Join(*process);
  EXPECT_EQ(process->ExitDescription(), "exit code 7");
  EXPECT_EQ(ReadFile(log_).value(), "one\ntwo\n");
}

TEST_F(ChildProcessTest, TerminateEndsTheChild) {
  const auto process = Shell("exec sleep 1000");
  EXPECT_EQ(process->ExitDescription(), "");
  process->Terminate();
  Join(*process);
  EXPECT_EQ(process->ExitDescription().rfind("signal 15", 0), 0u) << process->ExitDescription();
}

TEST_F(ChildProcessTest, DestructorKillsTheProcessGroup) {
  auto process = Shell("sleep 1000 & echo $!; wait");
  while (ReadFile(log_).value().find('\n') == std::string::npos) std::this_thread::yield();
  const pid_t grandchild = std::stoi(ReadFile(log_).value());
  process = nullptr;
  // Gone, or not yet reaped by init; the kernel may take a moment.
  const auto gone = [&] {
    const auto state = ReadFile("/proc/" + std::to_string(grandchild) + "/stat", 4096);
    return !state.ok() || state->find(") Z ") != std::string::npos;
  };
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (!gone() && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  EXPECT_TRUE(gone());
}

TEST_F(ChildProcessTest, AMissingProgramIsNotFound) {
  EXPECT_EQ(ChildProcess::Start("/no/such/program", {}, log_).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(ChildProcessTest, LastLinesOfALog) {
  ASSERT_TRUE(WriteFileAtomic(log_, "1\n2\n3\n4\n").ok());
  EXPECT_EQ(LastLines(log_, 2), "3\n4\n");
  EXPECT_EQ(LastLines(log_, 9), "1\n2\n3\n4\n");
  EXPECT_EQ(LastLines(log_ + "none", 2), "");
  ASSERT_TRUE(WriteFileAtomic(log_, "1\n2\nno end").ok());
  EXPECT_EQ(LastLines(log_, 2), "2\nno end");
}

}  // namespace
}  // namespace tessera

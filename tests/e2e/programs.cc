#include "tests/e2e/programs.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/storage/hash.h"
#include "server/client/base_job.h"
#include "tests/e2e/free_address.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;

constexpr double kPollSeconds = 0.01;

// Changes whenever a program is built anew.
std::string BuildStamp() {
  std::string stamp;
  for (const char* program : {TESSERA_PROGRAM, TESSERAD_PROGRAM, TESSERA_WORKER_PROGRAM}) {
    stamp += '-';
    stamp += std::to_string(StampOf(program).value().modified_ns);
  }
  return stamp;
}

// Makes `path` by `make(temporary path)` unless it is there; processes wait for each other.
void MakeOnce(const std::string& path, const std::function<void(const std::string&)>& make) {
  ASSERT_TRUE(EnsureFolder(TESSERA_E2E_SCENES).ok());
  const std::string lock_path = std::string(TESSERA_E2E_SCENES) + "/lock";
  ASSERT_TRUE(WaitUntil([&] {
    const auto lock = FileLock::Acquire(lock_path);
    if (!lock.ok()) return false;
    if (fs::exists(path)) return true;
    const std::string made = path + ".part";
    fs::remove_all(made);
    make(made);
    if (fs::exists(made)) fs::rename(made, path);
    return true;
  }));
  ASSERT_TRUE(fs::exists(path)) << path;
}

// Leaves only what belongs to the present build.
void DropOldScenes(const std::string& stamp) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(TESSERA_E2E_SCENES, ignored)) {
    const std::string name = entry.path().filename();
    if (name != "lock" && name.find(stamp) == std::string::npos) fs::remove_all(entry.path(), ignored);
  }
}

}  // namespace

bool WaitUntil(const std::function<bool()>& condition, double seconds) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::duration<double>(kPollSeconds));
  }
  return true;
}

Program::Program(const std::string& folder, const std::string& program, const std::vector<std::string>& arguments) {
  static std::atomic<int> count{0};
  EXPECT_TRUE(EnsureFolder(folder).ok());
  const std::string log = folder + "/" + fs::path(program).filename().string() + "-" + std::to_string(count++) + ".log";
  auto process = ChildProcess::Start(program, arguments, log);
  if (!process.ok()) throw std::runtime_error(process.status().ToString());
  process_ = *std::move(process);
}

void Program::Signal(int signal) {
  if (!process_->Running()) return;
  ::kill(process_->pid(), signal);
  siginfo_t unused;
  // The threads of a process stop one after the other: some may answer for a while.
  if (signal == SIGSTOP) ::waitid(P_PID, process_->pid(), &unused, WSTOPPED | WEXITED | WNOWAIT);
}

std::string Program::Output() const { return Content(process_->log()); }

Outcome Program::Wait() {
  EXPECT_TRUE(WaitUntil([&] { return !process_->Running(); })) << Output();
  const std::string ended = process_->ExitDescription();
  Outcome outcome;
  outcome.output = Output();
  if (ended.rfind("exit code ", 0) == 0) outcome.exit_code = std::stoi(ended.substr(10));
  return outcome;
}

void Program::Kill() {
  Signal(SIGKILL);
  EXPECT_TRUE(WaitUntil([&] { return !process_->Running(); }));
}

Outcome Tessera(const std::string& folder, const std::vector<std::string>& arguments) {
  return Program(folder, TESSERA_PROGRAM, arguments).Wait();
}

const std::string& ToyCity() {
  static const std::string city = [] {
    const std::string stamp = BuildStamp();
    const std::string path = std::string(TESSERA_E2E_SCENES) + "/city" + stamp;
    MakeOnce(path, [&](const std::string& made) {
      DropOldScenes(stamp);
      const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
      const Outcome outcome = Tessera(folder.path(), {"synth", made + "/city", "--toy", "--seed", "3", "--quiet"});
      EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    });
    return path + "/city";
  }();
  return city;
}

const std::string& UndisturbedMesh() {
  static const std::string mesh = UndisturbedResult(ToyCity(), {"--tiles", "4"}) + "/mesh.ply";
  return mesh;
}

const std::string& Street() {
  static const std::string street = [] {
    const std::string stamp = BuildStamp();
    const std::string path = std::string(TESSERA_E2E_SCENES) + "/street" + stamp;
    MakeOnce(path, [&](const std::string& made) {
      DropOldScenes(stamp);
      const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
      const Outcome outcome = Tessera(folder.path(), {"synth", made + "/street", "--blocks", "4x1", "--gsd", "0.6",
                                                      "--image-size", "160x120", "--quiet"});
      EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    });
    return path + "/street";
  }();
  return street;
}

const std::string& NextFlight() {
  static const std::string flight = [] {
    const std::string street = Street();
    const std::string path = std::string(TESSERA_E2E_SCENES) + "/next" + BuildStamp();
    MakeOnce(path, [&](const std::string& made) {
      const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
      const Outcome outcome = Tessera(
          folder.path(), {"synth", made + "/next", "--change", street, "--part", "0.75,0.2,0.95,0.8", "--quiet"});
      EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    });
    return path + "/next";
  }();
  return flight;
}

std::string UndisturbedResult(const std::string& scene, const std::vector<std::string>& arguments,
                              const std::string& base) {
  std::vector<std::string> run = {"run", scene};
  run.insert(run.end(), arguments.begin(), arguments.end());
  std::string of = base;
  for (const std::string& word : run) of += "\n" + word;
  const std::string path = std::string(TESSERA_E2E_SCENES) + "/result-" + Sha256Hex(of).substr(0, 12) + BuildStamp();
  MakeOnce(path, [&](const std::string& made) {
    const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
    run.insert(run.end(), {"--out", folder.path() + "/out"});
    if (!base.empty()) {
      CopyResult(base, folder.path() + "/base");
      run.insert(run.end(), {"--base", folder.path() + "/base"});
    }
    const Outcome outcome = Tessera(folder.path(), run);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    if (outcome.exit_code == 0) fs::copy(folder.path() + "/out", made, fs::copy_options::recursive);
  });
  return path;
}

void CopyResult(const std::string& from, const std::string& to) {
  fs::copy(from, to, fs::copy_options::recursive);
  ASSERT_TRUE(WriteRunResult(to + "/.tessera", {to + "/.tessera/data", "jobs/1"}).ok());
}

void CopyStreetResult(const std::string& to) { CopyResult(UndisturbedResult(Street(), {"--tiles", "8"}), to); }

void HarmFile(const std::string& path, Harm harm) {
  const auto half = static_cast<std::streamoff>(fs::file_size(path) / 2);
  if (harm == Harm::kFlip) {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(half);
    const int byte = file.get();
    file.seekp(half);
    file.put(static_cast<char>(byte ^ 1));
  } else if (harm == Harm::kCut) {
    // Not in its place: who has mapped it would be ended by the system.
    fs::copy_file(path, path + ".cut");
    fs::resize_file(path + ".cut", static_cast<uintmax_t>(half));
    fs::rename(path + ".cut", path);
  } else {
    fs::remove(path);
  }
}

std::vector<std::string> BlobsIn(const std::string& folder) {
  std::vector<std::string> blobs;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.path().filename().string().size() == 64) blobs.push_back(entry.path());
  }
  std::sort(blobs.begin(), blobs.end());
  return blobs;
}

std::string Content(const std::string& path) {
  auto content = ReadFile(path);
  EXPECT_TRUE(content.ok()) << content.status();
  return content.ok() ? *content : "";
}

std::map<std::string, int> AttemptsOf(const std::string& job_json, const std::string& kind) {
  std::map<std::string, int> attempts;
  const auto job = nlohmann::json::parse(Content(job_json), nullptr, false);
  EXPECT_TRUE(job.is_object()) << job_json;
  if (!job.is_object()) return attempts;
  for (const auto& task : job["tasks"]) {
    if (task["kind"] == kind) attempts[task["title"]] = task["attempts"];
  }
  return attempts;
}

Cluster::Cluster(const std::string& folder, double lease_s, const std::vector<std::string>& arguments,
                 const std::string& host)
    : folder_(folder), data_(folder + "/data"), coordinator_arguments_(arguments), address_(FreeAddress(host)) {
  coordinator_arguments_.insert(coordinator_arguments_.end(), {"--data", data_, "--lease-s", std::to_string(lease_s)});
  StartCoordinator();
}

void Cluster::StartCoordinator() {
  const std::string port_file = folder_ + "/address";
  fs::remove(port_file);
  coordinator_ = nullptr;
  std::vector<std::string> arguments = {"--listen", address_, "--port-file", port_file, "--scene-root", "/"};
  arguments.insert(arguments.end(), coordinator_arguments_.begin(), coordinator_arguments_.end());
  coordinator_ = std::make_unique<Program>(folder_, TESSERAD_PROGRAM, arguments);
  if (!WaitUntil([&] { return fs::exists(port_file) || !coordinator_->Running(); }) || !coordinator_->Running()) {
    throw std::runtime_error("tesserad: " + coordinator_->Output());
  }
  address_ = Content(port_file);
  address_.erase(address_.find_last_not_of('\n') + 1);
  if (connection_ == nullptr) connection_ = Connection::Open(address_, 30).value();
}

Program& Cluster::AddWorker(const std::vector<std::string>& arguments, const std::vector<std::string>& before) {
  std::vector<std::string> command = before;
  command.push_back(TESSERA_WORKER_PROGRAM);
  command.insert(command.end(), {"--threads", "1"});
  const auto given = [&](const char* option) {
    return std::find(arguments.begin(), arguments.end(), option) != arguments.end();
  };
  if (!given("--coordinator")) command.insert(command.end(), {"--coordinator", address_});
  if (!given("--work")) {
    command.insert(command.end(), {"--work", folder_ + "/work-" + std::to_string(workers_.size())});
  }
  command.insert(command.end(), arguments.begin(), arguments.end());
  workers_.push_back(std::make_unique<Program>(folder_, command.front(),
                                               std::vector<std::string>(command.begin() + 1, command.end())));
  return *workers_.back();
}

v1::Job Cluster::Submit(const std::string& scene, int tiles, const std::string& request_id, const std::string& base) {
  v1::CreateJobRequest request;
  request.set_scene_path(scene);
  request.set_request_id(request_id);
  request.mutable_settings()->set_tiles(tiles);
  request.mutable_settings()->mutable_update()->set_base(base);
  v1::Job job;
  const Status status = connection_->CreateJob(request, &job);
  EXPECT_TRUE(status.ok()) << status;
  return job;
}

v1::Job Cluster::Await(const std::string& name) {
  v1::Job job;
  EXPECT_TRUE(WaitUntil([&] {
    return connection_->GetJob(name, &job).ok() && job.state() != v1::JOB_STATE_QUEUED &&
           job.state() != v1::JOB_STATE_RUNNING;
  })) << coordinator_->Output();
  return job;
}

std::vector<v1::Task> Cluster::Tasks(const std::string& job) {
  v1::ListTasksResponse tasks;
  if (!connection_->ListTasks(job, &tasks).ok()) return {};
  return {tasks.tasks().begin(), tasks.tasks().end()};
}

std::string Cluster::Fetch(const std::string& job) {
  const std::string out = folder_ + "/fetched";
  const Outcome outcome = Tessera(folder_, {"fetch", job, "--out", out, "--coordinator", address_});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  return out;
}

}  // namespace tessera::e2e

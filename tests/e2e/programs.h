// Runs the programs under test as processes, and provides their scenes.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/storage/files.h"
#include "server/client/child_process.h"
#include "server/client/connection.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera::e2e {

// Polls until `condition` holds; false after `seconds`.
bool WaitUntil(const std::function<bool()>& condition, double seconds = 240);

struct Outcome {
  int exit_code = -1;
  std::string output;  // standard output and errors together
};

// A running program; its output goes to its own file in `folder`.
class Program {
 public:
  Program(const std::string& folder, const std::string& program, const std::vector<std::string>& arguments);
  pid_t pid() const { return process_->pid(); }
  bool Running() { return process_->Running(); }
  // "exit code 1", "signal 9 (Killed)"; empty while it runs.
  std::string ExitDescription() { return process_->ExitDescription(); }
  // After SIGSTOP waits until all threads have stopped.
  void Signal(int signal);
  std::string Output() const;
  Outcome Wait();
  // Sends SIGKILL and waits.
  void Kill();

 private:
  std::unique_ptr<ChildProcess> process_;
};

// Runs `tessera` with these arguments until it ends.
Outcome Tessera(const std::string& folder, const std::vector<std::string>& arguments);

// Folder of a toy city, made once per build of the programs. Read-only.
const std::string& ToyCity();

// mesh.ply of a job of four tiles on the toy city without faults, made once.
const std::string& UndisturbedMesh();

// A row of blocks; each image sees a part of it. Made once. Read-only.
const std::string& Street();

// A second flight, "next", over the street's end, as a separate scene, made once. Read-only.
const std::string& NextFlight();

// Result folder of `tessera run SCENE ARGUMENTS` without faults, made once. `base`: another such folder; the result is
// an update of it. Read-only.
std::string UndisturbedResult(const std::string& scene, const std::vector<std::string>& arguments,
                              const std::string& base = "");

// Copies such a folder with its state, so that it can be a base job. The job is jobs/1.
void CopyResult(const std::string& from, const std::string& to);

// Copies the result of the street in eight tiles.
void CopyStreetResult(const std::string& to);

enum class Harm { kFlip, kCut, kDelete };

// Flips a bit in the middle of the file, replaces it by a shorter one, or removes it.
void HarmFile(const std::string& path, Harm harm);

// All files of a folder of blobs, sorted.
std::vector<std::string> BlobsIn(const std::string& folder);

std::string Content(const std::string& path);

// Number of attempts of each task of a kind in job.json, by title.
std::map<std::string, int> AttemptsOf(const std::string& job_json, const std::string& kind);

// A coordinator and workers that a test can kill.
class Cluster {
 public:
  // `arguments`: further arguments of the coordinator, which listens on a free port of `host`.
  explicit Cluster(const std::string& folder, double lease_s = 3, const std::vector<std::string>& arguments = {},
                   const std::string& host = "127.0.0.1");
  // Starts the coordinator, on the port of the previous one if there was one.
  void StartCoordinator();
  Program& coordinator() { return *coordinator_; }
  // `arguments`: further arguments; `before`: command that runs the worker, such as setpriv or unshare.
  Program& AddWorker(const std::vector<std::string>& arguments = {}, const std::vector<std::string>& before = {});
  std::vector<std::unique_ptr<Program>>& workers() { return workers_; }
  Connection& connection() { return *connection_; }
  const std::string& address() const { return address_; }
  const std::string& data() const { return data_; }

  v1::Job Submit(const std::string& scene, int tiles, const std::string& request_id = "", const std::string& base = "");
  // Waits until the job has ended.
  v1::Job Await(const std::string& job);
  std::vector<v1::Task> Tasks(const std::string& job);
  // Fetches the job's files with `tessera fetch`; returns their folder.
  std::string Fetch(const std::string& job);

 private:
  const std::string folder_;
  const std::string data_;
  std::vector<std::string> coordinator_arguments_;
  std::string address_;
  std::unique_ptr<Program> coordinator_;
  std::vector<std::unique_ptr<Program>> workers_;
  std::unique_ptr<Connection> connection_;
};

}  // namespace tessera::e2e

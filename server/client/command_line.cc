#include "server/client/command_line.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <random>

#include "server/client/commands.h"
#include "server/client/job_words.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {

void AddCoordinatorOption(CLI::App& command, std::string* address) {
  *address = "127.0.0.1:7575";
  command.add_option("--coordinator", *address, "Where tesserad listens, HOST:PORT")
      ->envname("TESSERA_COORDINATOR")
      ->capture_default_str();
}

void AddJobOptions(CLI::App& command, JobFlags* flags) {
  command.add_option("SCENE", flags->scene, "Folder with a scene.json")->required();
  command.add_option("--tiles", flags->tiles, "Number of tiles; 0: as many as fit, 1: untiled")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command.add_option("--rounds", flags->rounds, "Rounds of shape and labels; 0: the default")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command.add_option("--method", flags->method, "Energies and solvers: tessera");
}

Status MakeRequest(const JobFlags& flags, v1::CreateJobRequest* request) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::absolute(flags.scene, error).lexically_normal();
  if (error) return absl::InvalidArgumentError(flags.scene + ": " + error.message());
  request->set_scene_path(path.string());
  request->mutable_settings()->set_tiles(flags.tiles);
  request->mutable_settings()->set_rounds(flags.rounds);
  request->mutable_settings()->set_method(flags.method);
  return absl::OkStatus();
}

std::string NewRequestId() {
  std::random_device random;
  char text[40];
  std::snprintf(text, sizeof(text), "%08x%08x%08x%08x", random(), random(), random(), random());
  return text;
}

int Complain(const std::string& command, const Status& status) {
  const std::string message(status.message().data(), status.message().size());
  std::fprintf(stderr, "tessera %s: %s\n", command.c_str(), message.c_str());
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
      return kExitBadInput;
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kDeadlineExceeded:
      return kExitUnavailable;
    case absl::StatusCode::kCancelled:
      return kExitCancelled;
    default:
      return kExitFailed;
  }
}

int ExitCodeOfJob(const v1::Job& job, bool bad_input) {
  if (job.state() == v1::JOB_SUCCEEDED) return kExitOk;
  const std::string why = job.error().empty() ? "" : ":\n" + job.error();
  std::fprintf(stderr, "%s %s%s\n", job.name().c_str(), JobStateWord(job.state()).c_str(), why.c_str());
  if (job.state() == v1::JOB_CANCELLED) return kExitCancelled;
  return bad_input ? kExitBadInput : kExitFailed;
}

}  // namespace tessera

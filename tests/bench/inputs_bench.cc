// Time to bring the inputs of a task to a worker from a blob service that answers late: several at once, and one after
// the other.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/clock.h"
#include "common/base/elapsed.h"
#include "common/base/random.h"
#include "common/rpc/channel.h"
#include "tests/support/fake_workers_service.h"
#include "worker/agent/task_files.h"

namespace tessera {
namespace {

struct BenchOptions {
  int files = 50, rounds = 3, delay_ms = 20;
  int64_t bytes = 200'000;
};

StatusOr<double> Bring(TaskFiles& files, const std::vector<std::vector<TaskInput>>& calls, const std::string& folder) {
  const SystemClock clock;
  const int64_t start_us = clock.MonotonicUs();
  for (const std::vector<TaskInput>& inputs : calls) {
    TESSERA_RETURN_IF_ERROR(files.BringInputs(inputs, folder, {}));
  }
  const double seconds = SecondsSince(clock, start_us);
  files.Release();
  return seconds;
}

Status Run(const BenchOptions& options) {
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("/tmp"));
  FakeWorkersService service;
  service.blobs().DelayStreams(std::chrono::milliseconds(options.delay_ms));
  TESSERA_ASSIGN_OR_RETURN(auto cache, BlobCache::Open(folder.path() + "/cache", int64_t{1} << 40));
  TaskFiles files(BlobClient(MakeChannel(service.address()), {}, RealSleeper()), std::move(cache), false, {});
  const std::string input_dir = folder.path() + "/in";
  TESSERA_RETURN_IF_ERROR(EnsureFolder(input_dir));
  Random random(1);
  for (int round = 0; round < options.rounds; ++round) {
    double seconds[2];
    for (const bool at_once : {false, true}) {
      std::vector<TaskInput> inputs;
      for (int i = 0; i < options.files; ++i) {
        std::string bytes(static_cast<size_t>(options.bytes), '\0');
        for (char& byte : bytes) byte = static_cast<char>(random.Bits());
        inputs.push_back({"input-" + std::to_string(i), service.blobs().Add(bytes), ""});
      }
      std::vector<std::vector<TaskInput>> calls = {inputs};
      if (!at_once) {
        calls.clear();
        for (const TaskInput& input : inputs) calls.push_back({input});
      }
      TESSERA_ASSIGN_OR_RETURN(seconds[at_once], Bring(files, calls, input_dir));
    }
    std::printf("%d files of %.0f KB, %d ms of delay: %.3f s at once, %.3f s one after the other, ratio %.1f\n",
                options.files, static_cast<double>(options.bytes) / 1e3, options.delay_ms, seconds[1], seconds[0],
                seconds[0] / seconds[1]);
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Brings the inputs of a task to a worker");
  tessera::BenchOptions options;
  app.add_option("--files", options.files, "Inputs of the task");
  app.add_option("--bytes", options.bytes, "Size of each");
  app.add_option("--delay-ms", options.delay_ms, "Delay of each answer");
  app.add_option("--rounds", options.rounds, "Repetitions, each with new contents");
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Run(options);
  if (!status.ok()) std::fprintf(stderr, "%s\n", std::string(status.message()).c_str());
  return status.ok() ? 0 : 1;
}

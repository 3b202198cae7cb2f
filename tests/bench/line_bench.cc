// line_bench SCENE WORK_DIR TILES [ROUNDS]: runs a job in this process and prints what each task took and did.
#include <cstdio>
#include <cstdlib>

#include "tests/support/in_process_line.h"

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: line_bench SCENE WORK_DIR TILES [ROUNDS]\n");
    return 2;
  }
  tessera::JobSettings settings;
  settings.tiles = std::atoi(argv[3]);
  if (argc > 4) settings.rounds = std::atoi(argv[4]);
  const auto run = [](const tessera::TaskRequest& request) {
    auto outcome = tessera::RunTask(request, tessera::TaskControl());
    if (outcome.ok()) std::printf("%-8s %s\n", request.kind.c_str(), outcome->stats.c_str());
    std::fflush(stdout);
    return outcome;
  };
  const auto tasks = tessera::RunLine(argv[1], argv[2], settings, run);
  if (!tasks.ok()) {
    std::fprintf(stderr, "%s\n", std::string(tasks.status().message()).c_str());
    return 1;
  }
  std::printf("%s/mesh.ply\n", tasks->back().output_dir.c_str());
  return 0;
}

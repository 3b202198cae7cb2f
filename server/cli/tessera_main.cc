// `tessera`: the client and the tools.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <vector>

#include "common/log/log.h"
#include "server/cli/commands.h"

namespace tessera {
namespace {

// What `tessera` prints without arguments.
constexpr char kFirstSteps[] =
    "Tessera refines semantic 3D city meshes from aerial images. The commands to begin with:\n"
    "  tessera synth city                          Make a procedural city with exact truth\n"
    "  tessera check city                          Check that a scene is ready for a job\n"
    "  tessera plan city                           Predict tiles, memory, time and price of a job\n"
    "  tessera run city --out out                  Refine a scene on this machine\n"
    "  tessera evaluate out/mesh.ply --scene city  Measure a mesh against the truth\n"
    "All commands: tessera --help. One command: tessera COMMAND --help.\n";

struct CommandGroup {
  const char* name;
  std::vector<void (*)(CLI::App&, int*)> add;  // each adds one command
};

const std::vector<CommandGroup>& Groups() {
  static const std::vector<CommandGroup> groups = {
      {"Scene",
       {AddImportCommand, AddCheckCommand, AddUploadCommand, AddSynthCommand, AddClassifyCommand, AddEvaluateCommand,
        AddRenderCommand}},
      {"Jobs",
       {AddRunCommand, AddPlanCommand, AddSubmitCommand, AddUpdateCommand, AddJobsCommand, AddWatchCommand,
        AddPriorityCommand, AddPauseCommand, AddResumeCommand, AddRetryCommand, AddCancelCommand, AddDeleteCommand}},
      {"Cluster", {AddAccessCommand, AddFleetCommand, AddHealthCommand}},
      {"Data", {AddFetchCommand, AddExportCommand, AddLineageCommand, AddRollbackCommand}}};
  return groups;
}

int Main(int argc, char** argv) {
  if (argc == 1) {
    std::fputs(kFirstSteps, stderr);
    return kExitUsage;
  }
  CLI::App app("Refine semantic 3D city meshes from aerial images");
  app.name("tessera");
  app.require_subcommand(1);
  app.set_version_flag("--version", TESSERA_VERSION);
  app.footer(
      "Options of a command: tessera COMMAND --help\n"
      "Example:\n"
      "  tessera synth city && tessera run city --out out && tessera evaluate out/mesh.ply --scene city");
  int exit_code = kExitOk;
  for (const CommandGroup& group : Groups()) {
    for (const auto add : group.add) {
      add(app, &exit_code);
      app.get_subcommands({}).back()->group(group.name);
    }
  }
  SetUpLog("warn", /*json=*/false).IgnoreError();  // standard output is for results
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  }
  return exit_code;
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) { return tessera::Main(argc, argv); }

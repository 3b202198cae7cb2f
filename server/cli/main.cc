// `tessera`: the client and the tools.
#include <CLI/CLI.hpp>

#include "server/cli/commands.h"

int main(int argc, char** argv) {
  CLI::App app(
      "Tessera refines city-scale semantic 3D meshes from aerial images.\n"
      "Try: tessera synth city && tessera run city --out out && tessera evaluate out/mesh.ply --scene city");
  app.name("tessera");
  app.require_subcommand(1);
  app.set_version_flag("--version", TESSERA_VERSION);
  int exit_code = tessera::kExitOk;
  tessera::AddRunCommand(app, &exit_code);
  tessera::AddPlanCommand(app, &exit_code);
  tessera::AddSubmitCommand(app, &exit_code);
  tessera::AddUpdateCommand(app, &exit_code);
  tessera::AddRollbackCommand(app, &exit_code);
  tessera::AddJobsCommand(app, &exit_code);
  tessera::AddWatchCommand(app, &exit_code);
  tessera::AddPriorityCommand(app, &exit_code);
  tessera::AddPauseCommand(app, &exit_code);
  tessera::AddResumeCommand(app, &exit_code);
  tessera::AddRetryCommand(app, &exit_code);
  tessera::AddCancelCommand(app, &exit_code);
  tessera::AddDeleteCommand(app, &exit_code);
  tessera::AddFetchCommand(app, &exit_code);
  tessera::AddLineageCommand(app, &exit_code);
  tessera::AddAccessCommand(app, &exit_code);
  tessera::AddCheckCommand(app, &exit_code);
  tessera::AddClassifyCommand(app, &exit_code);
  tessera::AddSynthCommand(app, &exit_code);
  tessera::AddEvaluateCommand(app, &exit_code);
  tessera::AddRenderCommand(app, &exit_code);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? tessera::kExitOk : tessera::kExitUsage;
  }
  return exit_code;
}

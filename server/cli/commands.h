// The commands of `tessera`.
#pragma once

namespace CLI {
class App;
}  // namespace CLI

namespace tessera {

// Exit codes of all commands.
inline constexpr int kExitOk = 0;
inline constexpr int kExitFailed = 1;       // the work failed (a job failed, a file could not be written, ...)
inline constexpr int kExitUsage = 2;        // wrong arguments
inline constexpr int kExitBadInput = 3;     // the input is wrong; standard error names the file and the fault
inline constexpr int kExitUnavailable = 4;  // no coordinator answers
inline constexpr int kExitPartial = 5;      // with quarantined tiles, or worse than its start
inline constexpr int kExitCancelled = 130;  // Ctrl-C, or the job was cancelled

// Each adds one subcommand to `app`. CLI11's callback runs the command and stores its exit code in *exit_code, which
// must outlive `app`. Results go to standard output, everything else to standard error. A command's description is one
// line, an imperative; details and examples are in its footer.
void AddAccessCommand(CLI::App& app, int* exit_code);
void AddCancelCommand(CLI::App& app, int* exit_code);
void AddCheckCommand(CLI::App& app, int* exit_code);
void AddClassifyCommand(CLI::App& app, int* exit_code);
void AddDeleteCommand(CLI::App& app, int* exit_code);
void AddEvaluateCommand(CLI::App& app, int* exit_code);
void AddExportCommand(CLI::App& app, int* exit_code);
void AddFetchCommand(CLI::App& app, int* exit_code);
void AddFleetCommand(CLI::App& app, int* exit_code);
void AddHealthCommand(CLI::App& app, int* exit_code);
void AddImportCommand(CLI::App& app, int* exit_code);
void AddJobsCommand(CLI::App& app, int* exit_code);
void AddLineageCommand(CLI::App& app, int* exit_code);
void AddPauseCommand(CLI::App& app, int* exit_code);
void AddPlanCommand(CLI::App& app, int* exit_code);
void AddPriorityCommand(CLI::App& app, int* exit_code);
void AddRenderCommand(CLI::App& app, int* exit_code);
void AddResumeCommand(CLI::App& app, int* exit_code);
void AddRetryCommand(CLI::App& app, int* exit_code);
void AddRollbackCommand(CLI::App& app, int* exit_code);
void AddRunCommand(CLI::App& app, int* exit_code);
void AddSubmitCommand(CLI::App& app, int* exit_code);
void AddSynthCommand(CLI::App& app, int* exit_code);
void AddUpdateCommand(CLI::App& app, int* exit_code);
void AddUploadCommand(CLI::App& app, int* exit_code);
void AddWatchCommand(CLI::App& app, int* exit_code);

}  // namespace tessera

// `tessera health`: whether a coordinator serves.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/health.h"

namespace tessera {
namespace {

struct HealthFlags {
  Endpoint coordinator;
  double timeout_s = 5;
};

StatusOr<int> Health(const HealthFlags& flags) {
  const Status status = CheckHealth(flags.coordinator, flags.timeout_s);
  if (status.ok()) {
    std::printf("serving\n");
    return kExitOk;
  }
  ReportError("health", status);
  return kExitFailed;
}

}  // namespace

void AddHealthCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<HealthFlags>();
  CLI::App* command = app.add_subcommand("health", "Check that a coordinator serves");
  command->footer(
      "Asks the health service of gRPC (grpc.health.v1) once, with the certificates and the token of the caller.\n"
      "Prints \"serving\", or the reason on standard error. Exit code: 0 it serves, 1 it does not, 2 wrong arguments.\n"
      "A coordinator that stops, or that cannot store its state, does not serve. A standby does not listen, so it "
      "does\n"
      "not serve either: a readiness probe keeps it out of a Service until it takes over. Do not use the command as a\n"
      "liveness probe, which would restart standbys.\n"
      "Examples:\n"
      "  tessera health --coordinator city-server:7575 --tls-ca ca.pem --token-file anna.token\n"
      "  tessera health --timeout-s 2 || echo down");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("--timeout-s", flags->timeout_s, "Seconds to wait for the answer")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  SetAction(command, exit_code, [flags] { return Health(*flags); });
}

}  // namespace tessera

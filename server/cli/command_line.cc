#include "server/cli/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <random>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/cli/commands.h"
#include "server/client/job_text.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

// "thin_plate" on the command line.
std::string FlagOf(std::string name) {
  std::replace(name.begin(), name.end(), '_', '-');
  return "--" + name;
}

void AddMethodOptions(CLI::App& command, JobSettings* settings) {
  const char* const group = "Method";
  command
      .add_option("--method", settings->method,
                  "Method: tessera; baseline (Vu et al. 2012, images only); paper (Blaha et al. 2017, its terms and "
                  "rounds); labels (labels only, geometry unchanged). The defaults below are those of tessera")
      ->type_name(absl::StrJoin(kMethods, "|"))
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--rounds", settings->rounds,
                  absl::StrCat("Rounds of geometry and labels, 1 to ", kMaxRounds,
                               "; rounds after the first use the finest level only; 0: the method's default"))
      ->capture_default_str()
      ->group(group);
  const auto add_number = [&](const auto& setting) {
    command
        .add_option(FlagOf(setting.name), settings->method_settings.*setting.value,
                    absl::StrCat(setting.meaning, " (default ", setting.standard, ")"))
        ->type_name(absl::StrCat(setting.low, "..", setting.high))
        ->group(group);
  };
  for (const auto& setting : RealSettings()) add_number(setting);
  for (const auto& setting : WholeSettings()) add_number(setting);
  for (const ListSetting& setting : ListSettings()) {
    command
        .add_option(FlagOf(setting.name), settings->method_settings.*setting.value,
                    absl::StrCat(setting.meaning, " (default ", absl::StrJoin(setting.standard, ","), ")"))
        ->type_name(absl::StrCat(setting.low, "..", setting.high, ",..."))
        ->delimiter(',')
        ->allow_extra_args(false)
        ->group(group);
  }
  for (const BoolSetting& setting : BoolSettings()) {
    command
        .add_option(FlagOf(setting.name), settings->method_settings.*setting.value,
                    absl::StrCat(setting.meaning, " (default ", setting.standard ? "true" : "false", ")"))
        ->type_name("true|false")
        ->group(group);
  }
}

}  // namespace

void AddCoordinatorOption(CLI::App& command, Endpoint* endpoint) {
  endpoint->address = DefaultAddress();
  command.add_option("--coordinator", endpoint->address, "Address of the coordinator, HOST:PORT or unix:PATH")
      ->envname("TESSERA_COORDINATOR")
      ->capture_default_str();
  AddTlsOptions(command, endpoint);
}

void AddTlsOptions(CLI::App& command, Endpoint* endpoint) {
  const char* const group = "Authentication";
  command
      .add_option("--tls-ca", endpoint->tls_ca,
                  "Certificate authority of the coordinator, PEM; without it the connection does not use TLS")
      ->envname("TESSERA_TLS_CA")
      ->type_name("FILE")
      ->group(group);
  command.add_option("--tls-cert", endpoint->tls_cert, "Client certificate, PEM, if the coordinator requires one")
      ->envname("TESSERA_TLS_CERT")
      ->type_name("FILE")
      ->group(group);
  command.add_option("--tls-key", endpoint->tls_key, "Key of the client certificate, PEM")
      ->envname("TESSERA_TLS_KEY")
      ->type_name("FILE")
      ->group(group);
  command.add_option("--token-file", endpoint->token_file, "File with the token that the calls carry")
      ->envname("TESSERA_TOKEN_FILE")
      ->type_name("FILE")
      ->group(group);
}

void AddJobOptions(CLI::App& command, JobFlags* flags) {
  command.add_option("SCENE", flags->scene, "Folder with a scene.json")->required();
  command
      .add_option("--tiles", flags->settings.tiles,
                  absl::StrCat("Number of tiles, 1 (untiled) to ", kMaxTiles, "; 0: as many as --tile-memory requires"))
      ->capture_default_str();
  command
      .add_option(
          "--tile-memory", flags->settings.tile_memory_bytes,
          "Largest memory of a worker for one tile; larger tiles are split (default 4GiB, or no limit with --tiles)")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/true))
      ->type_name("BYTES|MiB|GiB");
  command
      .add_option("--classifier", flags->settings.classifier,
                  "Source of class likelihoods: a model file of `tessera classify --save-model`; default (geometry and "
                  "greenness); none (the scene's own likelihoods). If not given: default when the scene has neither "
                  "likelihoods nor labels, else none")
      ->transform([](const std::string& given) {
        if (given == kDefaultClassifier || given == kNoClassifier || given.empty()) return given;
        std::error_code error;
        const std::filesystem::path path = std::filesystem::absolute(given, error).lexically_normal();
        return error ? given : path.string();
      })
      ->type_name("MODEL|default|none");
  AddMethodOptions(command, &flags->settings);
  command.parse_complete_callback([flags] {
    const Status status = CheckJobSettings(flags->settings);
    if (!status.ok()) throw CLI::ValidationError(std::string(status.message()));
  });
}

CLI::Option* AddPriorityOption(CLI::App& command, const std::string& name, int* priority) {
  return command
      .add_option(name, *priority,
                  "Priority, -100 to 100: a free worker takes the job of highest priority, then the oldest")
      ->check(CLI::Range(-100, 100))
      ->capture_default_str();
}

void AddUpdateOptions(CLI::App& command, const std::string& base_values, JobFlags* flags) {
  const char* const group = "Update";
  UpdateSettings& update = flags->settings.update;
  command
      .add_option("--base", update.base,
                  "Update the result of this base job: only tiles with new, withdrawn or changed images, or with a "
                  "changed mesh, are refined; the others keep their bytes. SCENE is the whole scene, or only the new "
                  "images (no mesh). JOB: " +
                      base_values)
      ->type_name("JOB")
      ->group(group);
  command
      .add_option("--withdraw", update.withdraw,
                  "Flight of the base job whose images are no longer used; may be repeated")
      ->type_name("FLIGHT")
      ->allow_extra_args(false)
      ->group(group);
  command
      .add_option("--epochs", flags->epochs,
                  "Images to use: newest (where the newest flight covers a cell well enough, older images of it are "
                  "left out) or all")
      ->check(CLI::IsMember({"newest", "all"}))
      ->capture_default_str()
      ->group(group);
  command
      .add_flag("--from-scratch", update.from_scratch,
                "Refine changed tiles from the start mesh, and every tile that depends on them; the result equals a "
                "job on all images")
      ->group(group);
}

void AddPriceLimit(CLI::App& command, JobFlags* flags) {
  CLI::Option* const price =
      command
          .add_option("--price-per-core-hour", flags->price_per_core_hour, "Price of one core-hour, for --max-price")
          ->check(CLI::PositiveNumber);
  command
      .add_option("--max-price", flags->max_price,
                  "Refuse the job before refinement starts if its predicted price is higher")
      ->check(CLI::PositiveNumber)
      ->needs(price);
}

Status MakeRequest(const JobFlags& flags, v1::CreateJobRequest* request) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::absolute(flags.scene, error).lexically_normal();
  if (error) return absl::InvalidArgumentError(flags.scene + ": " + error.message());
  request->set_scene_path(path.string());
  JobSettings settings = flags.settings;
  settings.update.all_epochs = flags.epochs == "all";
  constexpr double kHour = 3600;
  if (flags.max_price > 0) settings.max_core_seconds = flags.max_price / flags.price_per_core_hour * kHour;
  ToProto(settings, request->mutable_settings());
  return absl::OkStatus();
}

std::string NewRequestId() {
  std::random_device random;
  char text[40];
  std::snprintf(text, sizeof(text), "%08x%08x%08x%08x", random(), random(), random(), random());
  return text;
}

int ReportError(const std::string& command, const Status& status) {
  const std::string message(status.message().data(), status.message().size());
  std::fprintf(stderr, "tessera %s: %s\n", command.c_str(), PrintableLines(message).c_str());
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
  if (job.state() == v1::JOB_STATE_SUCCEEDED) return kExitOk;
  const std::string why = job.error().empty() ? "" : ":\n" + job.error();
  std::fprintf(stderr, "%s %s%s\n", job.name().c_str(), JobStateName(job.state()).c_str(), PrintableLines(why).c_str());
  if (job.state() == v1::JOB_STATE_CANCELLED) return kExitCancelled;
  if (job.state() == v1::JOB_STATE_PARTIAL) return kExitPartial;
  return bad_input ? kExitBadInput : kExitFailed;
}

}  // namespace tessera

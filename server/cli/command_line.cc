#include "server/cli/command_line.h"

#include <google/protobuf/util/json_util.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "common/base/clock.h"
#include "common/exporting/export_format.h"
#include "common/job/task_parameters.h"
#include "common/s3/s3_location.h"
#include "common/storage/files.h"
#include "server/cli/commands.h"
#include "server/client/artifacts.h"
#include "server/client/connection.h"
#include "server/client/interrupt.h"
#include "server/client/job_text.h"
#include "server/client/local_cluster.h"
#include "server/display/progress_display.h"
#include "server/display/run_summary.h"
#include "server/report_page/write_report_page.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

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
  const auto add = [&](const auto& setting, const std::string& standard, const std::string& type) {
    return command
        .add_option("--" + absl::StrReplaceAll(setting.name, {{"_", "-"}}), settings->method_settings.*setting.value,
                    absl::StrCat(setting.meaning, " (default ", standard, ")"))
        ->type_name(type)
        ->group(group);
  };
  const auto range = [](const auto& setting) { return absl::StrCat(setting.low, "..", setting.high); };
  for (const auto& setting : RealSettings()) add(setting, absl::StrCat(setting.standard), range(setting));
  for (const auto& setting : WholeSettings()) add(setting, absl::StrCat(setting.standard), range(setting));
  for (const ListSetting& setting : ListSettings()) {
    add(setting, absl::StrJoin(setting.standard, ","), range(setting) + ",...")
        ->delimiter(',')
        ->allow_extra_args(false);
  }
  for (const BoolSetting& setting : BoolSettings()) {
    add(setting, setting.standard ? "true" : "false", "true|false");
  }
}

// Whether the report of a job that succeeded says that its result fits worse than its start. False if it has no report,
// or the report is no longer stored.
StatusOr<bool> HasWorseResult(Connection& connection, v1::Job job) {
  TESSERA_RETURN_IF_ERROR(TakeArtifacts(connection, kReportFile, &job));
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("", "tessera-watch-"));
  const Status fetched = FetchArtifacts(connection, job, folder.path(), folder.path() + "/.fetch", {}).status();
  if (absl::IsNotFound(fetched)) return false;
  TESSERA_RETURN_IF_ERROR(fetched);
  return ResultIsWorse(folder.path());
}

}  // namespace

void AddCoordinatorOption(CLI::App& command, Endpoint* endpoint) {
  endpoint->address = DefaultAddress();
  command
      .add_option(
          "--coordinator", endpoint->address,
          "Address of the coordinator, HOST:PORT or unix:PATH; a list HOST:PORT,HOST:PORT of those that take over "
          "from each other")
      ->envname("TESSERA_COORDINATOR")
      ->capture_default_str();
  AddTlsOptions(command, endpoint);
}

void AddTlsOptions(CLI::App& command, Endpoint* endpoint) {
  const std::tuple<const char*, const char*, std::string*, const char*> options[] = {
      {"--tls-ca", "TESSERA_TLS_CA", &endpoint->tls_ca,
       "Certificate authority of the coordinator, PEM; without it the connection does not use TLS"},
      {"--tls-cert", "TESSERA_TLS_CERT", &endpoint->tls_cert,
       "Client certificate, PEM, if the coordinator requires one"},
      {"--tls-key", "TESSERA_TLS_KEY", &endpoint->tls_key, "Key of the client certificate, PEM"},
      {"--token-file", "TESSERA_TOKEN_FILE", &endpoint->token_file, "File with the token that the calls carry"},
      {"--s3-ca", "AWS_CA_BUNDLE", &endpoint->store_ca,
       "Certificate authorities of the coordinator's S3 store, PEM, if it has one (default: the system's)"}};
  for (const auto& [name, variable, value, help] : options) {
    command.add_option(name, *value, help)->envname(variable)->type_name("FILE")->group("Authentication");
  }
}

void AddTileOptions(CLI::App& command, JobSettings* settings) {
  command
      .add_option("--tiles", settings->tiles,
                  absl::StrCat("Number of tiles, 1 (untiled) to ", kMaxTiles, "; 0: as many as --tile-memory requires"))
      ->capture_default_str();
  command
      .add_option(
          "--tile-memory", settings->tile_memory_bytes,
          "Largest memory of a worker for one tile; larger tiles are split (default 4GiB, or no limit with --tiles)")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/true))
      ->type_name("BYTES|MiB|GiB");
}

void AddSceneOptions(CLI::App& command, double* skip_images, bool* anyway) {
  command
      .add_option("--skip-images", *skip_images,
                  "Leave out images whose files are missing or broken, up to this share of all images: 0.1 is 10 %; "
                  "they are listed in the warnings and in report.json. Without it they are errors")
      ->check(CLI::Range(0.0, kMaxSkippedShare))
      ->type_name("SHARE");
  command.add_flag("--anyway", *anyway,
                   "Go on, with a warning, although images, poses and mesh do not fit, or likelihoods and labels");
}

void AddJobOptions(CLI::App& command, JobFlags* flags) {
  command.add_option("SCENE", flags->scene, "Folder with a scene.json, or s3://BUCKET/PREFIX")->required();
  AddTileOptions(command, &flags->settings);
  command
      .add_option("--classifier", flags->settings.classifier,
                  "Source of class likelihoods: a model file of `tessera classify --save-model`; default (geometry and "
                  "greenness); none (the scene's own likelihoods). If not given: default when the scene has neither "
                  "likelihoods nor labels, else none")
      ->transform([](const std::string& given) {
        const bool is_path = given != kDefaultClassifier && given != kNoClassifier && !given.empty();
        return is_path ? AbsolutePath(given) : given;
      })
      ->type_name("MODEL|default|none");
  AddSceneOptions(command, &flags->settings.skip_images, &flags->settings.anyway);
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
                "Refine all tiles from the start mesh again, with the faces of the base job; the result does not "
                "depend on earlier flights")
      ->group(group);
}

void AddExportOptions(CLI::App& command, ExportSettings* settings) {
  const char* const group = "Export";
  std::string formats;
  for (const ExportFormat& format : ExportFormats()) {
    absl::StrAppend(&formats, formats.empty() ? "" : "; ", std::string(format.name), " (", std::string(format.what),
                    ")");
  }
  command.add_option("--formats", settings->formats, "Also export the result to OUT/export/FORMAT/: " + formats)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("FORMAT[,FORMAT]")
      ->group(group);
  command
      .add_option("--export-crs", settings->crs,
                  "Coordinate reference system of exported files (default: that of the scene's source)")
      ->type_name("EPSG:H[+V]")
      ->group(group);
  command
      .add_option("--color", settings->color,
                  "What colours of vertices show (default class); image: the photographs, which takes longer")
      ->type_name("class|image|confidence|displacement")
      ->group(group);
  command
      .add_option("--export-gsd", settings->gsd_m,
                  "Size of a pixel of exported rasters in metres (default: the GSD of the scene)")
      ->check(CLI::PositiveNumber)
      ->type_name("METRES")
      ->group(group);
  command
      .add_option_function<std::string>(
          "--materials", [settings](const std::string& by) { settings->class_materials = by == "class"; },
          "Write a material for each class (obj)")
      ->check(CLI::IsMember({"class"}))
      ->type_name("class")
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

v1::CreateJobRequest MakeRequest(const JobFlags& flags) {
  v1::CreateJobRequest request;
  request.set_scene_path(IsS3Url(flags.scene) ? std::string(absl::StripSuffix(flags.scene, "/"))
                                              : AbsolutePath(flags.scene));
  JobSettings settings = flags.settings;
  settings.update.all_epochs = flags.epochs == "all";
  constexpr double kHour = 3600;
  if (flags.max_price > 0) settings.max_core_seconds = flags.max_price / flags.price_per_core_hour * kHour;
  ToProto(settings, request.mutable_settings());
  return request;
}

Status CheckSceneExists(const v1::CreateJobRequest& request) {
  if (IsS3Url(request.scene_path()) || FileExists(request.scene_path())) return absl::OkStatus();
  return absl::InvalidArgumentError(request.scene_path() + ": no such folder, expected a folder with scene.json");
}

StatusOr<std::string> ProtoJson(const google::protobuf::Message& message, bool indented) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  options.add_whitespace = indented;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(message, &text, options);
  if (!status.ok()) return absl::InternalError(status.ToString());
  return text;
}

Status WriteOutput(const std::string& path, const std::string& content) {
  const Status written = WriteFileAtomic(path, content);
  return written.ok() ? written : absl::InternalError(written.message());
}

void SetAction(CLI::App* command, int* exit_code, std::function<StatusOr<int>()> run) {
  command->callback([command, exit_code, run = std::move(run)] {
    const StatusOr<int> code = run();
    *exit_code = code.ok() ? *code : ReportError(command->get_name(), code.status());
  });
}

Status WithLocalCluster(const LocalClusterOptions& options,
                        const std::function<Status(LocalCluster&, Connection&)>& use) {
  const SystemClock clock;
  TESSERA_ASSIGN_OR_RETURN(const auto cluster, LocalCluster::Start(options, clock, InterruptibleSleep(1)));
  Status status;
  {
    const auto connection = Connection::Open(cluster->address());
    status = connection.ok() ? use(*cluster, **connection) : connection.status();
  }
  cluster->Stop(LocalCluster::kStopSeconds, InterruptibleSleep(2));
  return status;
}

StatusOr<int> WatchJob(Connection& connection, const std::string& name,
                       const std::function<void(const v1::WatchJobResponse&)>& show) {
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection.WatchJob(name, [&](const v1::WatchJobResponse& update) {
    job = update.job();
    show(update);
  }));
  const int code = ExitCodeOfJob(job, job.state() == v1::JOB_STATE_FAILED && connection.FailedForInput(name));
  if (code != kExitOk) return code;
  TESSERA_ASSIGN_OR_RETURN(const bool is_worse, HasWorseResult(connection, job));
  if (!is_worse) return kExitOk;
  std::fprintf(stderr, "%s: the result fits the images worse than the start mesh: see its report.json\n",
               job.name().c_str());
  return kExitPartial;
}

StatusOr<int> WatchJobWithProgress(Connection& connection, const std::string& job) {
  ProgressDisplay display(stderr);
  return WatchJob(connection, job, [&](const v1::WatchJobResponse& update) { display.Show(update); });
}

std::string WritePageOrWarn(const v1::Job& job, const std::string& out, const TaskControl& control) {
  const StatusOr<std::string> path = WriteReportPage(job, out, TESSERA_VERSION, control);
  if (path.ok()) return *path;
  PrintWarnings(Warnings{absl::StrCat(kReportPageFile, " is not written: ", std::string(path.status().message()))});
  return "";
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
  // Paths in errors of tasks are relative to the scene.
  const std::string scene = job.error().empty() || job.scene_path().empty() ? "" : " (scene " + job.scene_path() + ")";
  std::fprintf(stderr, "%s %s%s%s\n", job.name().c_str(), JobStateName(job.state()).c_str(),
               PrintableLines(scene).c_str(), PrintableLines(why).c_str());
  if (job.state() == v1::JOB_STATE_CANCELLED) return kExitCancelled;
  if (job.state() == v1::JOB_STATE_PARTIAL) return kExitPartial;
  return bad_input ? kExitBadInput : kExitFailed;
}

}  // namespace tessera

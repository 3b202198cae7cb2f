// `tessera upload SCENE s3://BUCKET/PREFIX`: copies a scene to an S3 store and writes its manifest.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "common/base/clock.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_credentials.h"
#include "common/s3/s3_location.h"
#include "common/scene/scene_upload.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/interrupt.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

struct UploadFlags {
  std::vector<std::string> places;  // SCENE and URL, or URL alone with --in-place
  std::string endpoint, region = "us-east-1", ca_file;
  bool in_place = false, quiet = false;
};

StatusOr<int> Upload(const UploadFlags& flags) {
  InstallInterruptCounter();
  const SystemClock clock;
  const std::unique_ptr<S3CredentialsSource> credentials = DefaultS3Credentials(&clock);
  TESSERA_ASSIGN_OR_RETURN(const S3Location location, ParseS3Url(flags.places.back(), flags.endpoint, flags.region));
  S3ClientOptions options;
  options.ca_file = flags.ca_file;
  options.sleeper = InterruptibleSleep(1);
  options.retry.seed = static_cast<uint64_t>(clock.UnixTimeUs());
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<S3Client> client,
                           S3Client::Create(location, credentials.get(), &clock, options));
  StatusOr<SceneUpload> upload = absl::UnknownError("");
  {
    StageLine line(!flags.quiet);
    TaskControl control;
    control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
    control.cancelled = [] { return Interrupts() > 0; };
    if (flags.in_place) {
      TESSERA_ASSIGN_OR_RETURN(const TempFolder scratch, TempFolder::Create(""));
      upload = DescribeStoredScene(*client, scratch.path(), control);
    } else {
      upload = UploadScene(AbsolutePath(flags.places.front()), *client, control);
    }
  }
  TESSERA_RETURN_IF_ERROR(upload.status());
  const auto files = static_cast<int64_t>(upload->manifest.files.size());
  std::printf("%s%s\n", ToText(location).c_str(), kManifestName);
  if (!flags.quiet && !flags.in_place) {
    std::fprintf(stderr, "%lld files, %.1f MB: %lld sent, %lld were there\n", static_cast<long long>(files),
                 static_cast<double>(upload->bytes) * 1e-6, static_cast<long long>(upload->sent_files),
                 static_cast<long long>(files - upload->sent_files));
  }
  Warnings faults;
  for (const ManifestFile& file : upload->manifest.files) {
    if (file.fault) faults.push_back(std::string(FaultOf(file, "").message()));
  }
  PrintWarnings(faults);
  return kExitOk;
}

}  // namespace

void AddUploadCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<UploadFlags>();
  CLI::App* command = app.add_subcommand("upload", "Upload a scene to an S3 store");
  command
      ->add_option("PLACES", flags->places,
                   "Folder of the scene, and s3://BUCKET/PREFIX to copy it to; the latter alone with --in-place")
      ->required()
      ->type_name("[SCENE] URL")
      ->expected(1, 2);
  command->add_flag("--in-place", flags->in_place, "Read once what lies at URL already, and only write its manifest");
  command->add_option("--s3-endpoint", flags->endpoint, "Address of the S3 store (default: Amazon's of the region)")
      ->envname("AWS_ENDPOINT_URL")
      ->type_name("URL");
  command->add_option("--s3-region", flags->region, "Region that requests to the S3 store are signed for")
      ->envname("AWS_REGION")
      ->capture_default_str();
  command->add_option("--s3-ca", flags->ca_file, "Certificate authorities of the S3 store, PEM")
      ->envname("AWS_CA_BUNDLE")
      ->type_name("FILE");
  command->add_flag("--quiet", flags->quiet, "Print neither progress nor the summary");
  command->footer(
      "Sends several files at once and writes tessera.manifest.json last: name, size and SHA-256 of every file, and\n"
      "the headers of images. A coordinator with --scene-root s3://BUCKET/PREFIX takes it as the scene of a job.\n"
      "An interrupted upload goes on when repeated: files that lie there with the same size and hash are not sent\n"
      "again. Files and folders whose names begin with a dot are left out.\n"
      "Credentials are read as by AWS's tools: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or the profile "
      "AWS_PROFILE\n"
      "of ~/.aws/credentials and ~/.aws/config, also its credential_process, or the container endpoint.\n"
      "Examples:\n"
      "  tessera upload city s3://scenes/city --s3-endpoint https://s3.example.org\n"
      "  tessera submit s3://scenes/city\n"
      "  tessera upload --in-place s3://scenes/city --s3-endpoint https://s3.example.org");
  command->parse_complete_callback([flags] {
    const size_t expected = flags->in_place ? 1 : 2;
    if (flags->places.size() != expected || !IsS3Url(flags->places.back())) {
      throw CLI::ValidationError(flags->in_place ? "expected one URL, such as s3://scenes/city, with --in-place"
                                                 : "expected a folder and a URL, such as: city s3://scenes/city");
    }
  });
  SetAction(command, exit_code, [flags] { return Upload(*flags); });
}

}  // namespace tessera

// What a coordinator reads of a large scene in an S3 store before it accepts a job.
//   scene_bench --s3 s3://BUCKET/PREFIX --s3-endpoint http://127.0.0.1:PORT [--images 10000] [--kb 100]
// Makes a scene of so many images of this size, uploads it, reads it as a submission does, and removes it. Credentials
// as of tesserad. Prints seconds, and the share of the scene's bytes that were read.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/clock.h"
#include "common/base/random.h"
#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"
#include "common/s3/s3_credentials.h"
#include "common/scene/scene_upload.h"
#include "common/scene/stored_scenes.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"
#include "server/admission/scene_reader.h"
#include "tests/bench/or_exit.h"

namespace tessera {
namespace {

constexpr int kWidth = 64, kHeight = 48;

// Images in rows over a square of the ground, looking down. Each file has bytes of its own behind the picture.
void MakeScene(const std::string& folder, int images, int64_t image_bytes) {
  Check(EnsureFolder(folder + "/images"));
  Check(EnsureFolder(folder + "/colmap"));
  Check(WriteFileAtomic(folder + "/scene.json", "{\"tessera_scene\": 1}\n"));
  Check(WriteFileAtomic(folder + "/colmap/cameras.txt",
                        absl::StrFormat("1 PINHOLE %d %d 60 60 32 24\n", kWidth, kHeight)));
  TriangleMesh ground;
  ground.vertices = {{0, 0, 0}, {1000, 0, 0}, {0, 1000, 0}};
  ground.faces = {{0, 1, 2}};
  ground.labels = {0};
  Check(WritePly(folder + "/mesh.ply", ground));
  Check(WriteJpeg(folder + "/picture", ByteImage(kWidth, kHeight, 3), 90));
  const std::string picture = Value(ReadFile(folder + "/picture"));
  Check(RemoveTree(folder + "/picture"));
  Random random(1);
  std::string model;
  for (int i = 0; i < images; ++i) {
    const std::string name = absl::StrFormat("%06d.jpg", i);
    // A rotation by 180 degrees about x looks down; t = -R c.
    absl::StrAppendFormat(&model, "%d 0 1 0 0 %d %d 100 1 %s\n\n", i + 1, -10 * (i % 100), 10 * (i / 100), name);
    std::string bytes = picture;
    while (static_cast<int64_t>(bytes.size()) < image_bytes) {
      const uint64_t bits = random.Bits();
      bytes.append(reinterpret_cast<const char*>(&bits), sizeof(bits));
    }
    Check(WriteFileAtomic(folder + "/images/" + name, bytes));
  }
  Check(WriteFileAtomic(folder + "/colmap/images.txt", model));
}

int Main(int argc, char** argv) {
  std::string url, endpoint;
  int images = 10'000;
  double kilobytes = 100;
  CLI::App app("Measure reading a scene in an S3 store", "scene_bench");
  app.add_option("--s3", url, "s3://BUCKET/PREFIX")->required();
  app.add_option("--s3-endpoint", endpoint, "Its address, http://127.0.0.1:PORT")->required();
  app.add_option("--images", images, "Number of images");
  app.add_option("--kb", kilobytes, "Size of an image, KB");
  CLI11_PARSE(app, argc, argv);
  SystemClock clock;
  const auto credentials = DefaultS3Credentials(&clock);
  S3Location location = Value(ParseS3Url(url, endpoint, "us-east-1"));
  location.prefix += UniqueName() + "/";
  const auto client = Value(S3Client::Create(location, credentials.get(), &clock));
  const TempFolder folder = Value(TempFolder::Create(""));
  MakeScene(folder.path(), images, static_cast<int64_t>(kilobytes * 1e3));
  SceneUpload upload;
  const double upload_s = Seconds([&] { upload = Value(UploadScene(folder.path(), *client, {})); });

  const auto scenes =
      Value(StoredScenes::Open({ToText(location)}, endpoint, "us-east-1", credentials.get(), &clock, {}));
  SceneListing listing;
  SceneRequest request;
  request.classifier = "none";
  const double read_s =
      Seconds([&] { listing = Value(ReadStoredScene(ToText(location), request, AllowedFiles::All(), *scenes, {})); });
  int64_t received = 0, calls = 0;
  for (const auto& [method, counts] : scenes->counts()) {
    received += counts.received_bytes;
    calls += counts.calls;
  }
  std::printf("%d images, %.1f MB: upload %.1f s; read by a submission in %.2f s, %lld calls, %.1f MB, share %.4f\n",
              images, static_cast<double>(upload.bytes) / 1e6, upload_s, read_s, static_cast<long long>(calls),
              static_cast<double>(received) / 1e6, static_cast<double>(received) / static_cast<double>(upload.bytes));
  if (static_cast<int>(listing.digests.size()) != images + 4) Check(absl::DataLossError("the listing lacks files"));
  std::vector<std::string> keys = {kManifestName};
  for (const ManifestFile& file : upload.manifest.files) keys.push_back(file.name);
  Check(client->Delete(keys));
  return 0;
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) { return tessera::Main(argc, argv); }

#include "common/scene/stored_scenes.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <unordered_map>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "common/scene/scene_json.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr char kSceneFileName[] = "scene.json";
constexpr int64_t kMaxSceneJsonBytes = 64 << 20;
constexpr size_t kShownNames = 3;

Status CancelledScene() { return absl::CancelledError("cancelled while a scene was read"); }

// Passes an object's bytes to `take` and hashes them.
StatusOr<Digest> StreamObject(S3Client& client, const std::string& key, const std::function<bool()>& cancelled,
                              const std::function<Status(std::string_view)>& take) {
  Sha256Hasher hasher;
  int64_t size = 0;
  TESSERA_RETURN_IF_ERROR(client.Stream(key, 0, [&](std::string_view bytes) -> Status {
    if (cancelled && cancelled()) return CancelledScene();
    hasher.Update(bytes.data(), bytes.size());
    size += static_cast<int64_t>(bytes.size());
    return take(bytes);
  }));
  return Digest{hasher.Finish(), size};
}

// Fetches files of one scene into a folder, and compares them with the manifest.
class SceneFetcher {
 public:
  SceneFetcher(const StoredScenes::Place& place, const std::function<bool()>& cancelled, FetchedScene* fetched)
      : client_(*place.client),
        prefix_(place.key.empty() ? "" : place.key + "/"),
        cancelled_(cancelled),
        fetched_(*fetched) {}

  Status ReadManifest() {
    const std::string name = absl::StrCat(fetched_.url, "/", kManifestName);
    const auto text = client_.Get(prefix_ + kManifestName, 0, kMaxManifestBytes + 1);
    if (absl::IsNotFound(text.status())) {
      return InputError(name, "", "no such object",
                        absl::StrCat("the manifest of a scene: write it by tessera upload SCENE ", fetched_.url,
                                     ", or by tessera upload --in-place ", fetched_.url));
    }
    TESSERA_RETURN_IF_ERROR(text.status());
    TESSERA_ASSIGN_OR_RETURN(fetched_.manifest, ParseManifest(*text, name));
    return absl::OkStatus();
  }

  // Compares names and sizes of all objects with the manifest's.
  Status ReadList() {
    std::unordered_map<std::string, int64_t> sizes;
    std::string from;
    do {
      if (cancelled_ && cancelled_()) return CancelledScene();
      TESSERA_ASSIGN_OR_RETURN(S3Page page, client_.List(prefix_, from));
      for (const S3Object& object : page.objects) {
        const std::string name = object.key.substr(prefix_.size());
        sizes[name] = object.size_bytes;
        if (!IsPartOfScene(name)) continue;
        const ManifestFile* const file = FindFile(fetched_.manifest, name);
        if (file == nullptr) {
          fetched_.not_in_manifest.push_back(name);
        } else if (file->digest.size_bytes != object.size_bytes) {
          fetched_.other_sizes[name] =
              Changed(name, absl::StrCat(object.size_bytes, " bytes"), absl::StrCat(file->digest.size_bytes, " bytes"));
        }
      }
      from = page.next;
    } while (!from.empty());
    std::erase_if(fetched_.manifest.files, [&](const ManifestFile& file) { return !sizes.contains(file.name); });
    return absl::OkStatus();
  }

  // Writes the file below the folder, with its time.
  Status Fetch(const ManifestFile& file) {
    const std::string path = absl::StrCat(fetched_.folder, "/", file.name);
    TESSERA_RETURN_IF_ERROR(EnsureFolder(fs::path(path).parent_path().string()));
    std::ofstream out(path, std::ios::binary);
    int64_t left = file.digest.size_bytes;
    const auto found = StreamObject(client_, prefix_ + file.name, cancelled_, [&](std::string_view bytes) -> Status {
      left -= static_cast<int64_t>(bytes.size());
      if (left < 0) {
        return Changed(file.name, "more", absl::StrCat(file.digest.size_bytes, " bytes"));
      }
      out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
      return out ? absl::OkStatus() : absl::ResourceExhaustedError(absl::StrCat("cannot write ", path));
    });
    TESSERA_RETURN_IF_ERROR(found.status());
    out.close();
    if (!out) return absl::ResourceExhaustedError(absl::StrCat("cannot write ", path));
    if (!(*found == file.digest)) {
      return Changed(file.name, absl::StrCat("the content ", found->sha256),
                     absl::StrCat("the content ", file.digest.sha256));
    }
    const timespec modified = {file.modified_ns / 1'000'000'000, file.modified_ns % 1'000'000'000};
    const timespec times[] = {modified, modified};
    ::utimensat(AT_FDCWD, path.c_str(), times, 0);
    return absl::OkStatus();
  }

  Status FetchHead(const ManifestFile& file) {
    TESSERA_ASSIGN_OR_RETURN(fetched_.heads[file.name], client_.Get(prefix_ + file.name, 0, kMeshHeadBytes));
    return absl::OkStatus();
  }

 private:
  Status Changed(const std::string& name, const std::string& found, const std::string& expected) const {
    return InputError(absl::StrCat(fetched_.url, "/", name), "", found,
                      absl::StrCat(expected, ", as in ", kManifestName, ": repeat tessera upload after a change"));
  }

  S3Client& client_;
  const std::string prefix_;
  const std::function<bool()>& cancelled_;
  FetchedScene& fetched_;
};

}  // namespace

StatusOr<std::unique_ptr<StoredScenes>> StoredScenes::Open(const std::vector<std::string>& roots,
                                                           const std::string& endpoint, const std::string& region,
                                                           S3CredentialsSource* credentials, const Clock* clock,
                                                           const S3ClientOptions& options) {
  auto scenes = std::make_unique<StoredScenes>();
  for (const std::string& url : roots) {
    TESSERA_ASSIGN_OR_RETURN(const S3Location location, ParseS3Url(url, endpoint, region));
    TESSERA_ASSIGN_OR_RETURN(auto client, S3Client::Create(location, credentials, clock, options));
    std::string name = ToText(location);
    while (name.ends_with('/')) name.pop_back();
    scenes->roots_.push_back({std::move(name), std::move(client)});
  }
  return scenes;
}

StatusOr<StoredScenes::Place> StoredScenes::Find(const std::string& url) const {
  for (const Root& root : roots_) {
    if (url == root.url) return Place{root.client.get(), ""};
    if (absl::StartsWith(url, root.url + "/")) return Place{root.client.get(), url.substr(root.url.size() + 1)};
  }
  return InputError(url, "", "a place that is in no --scene-root",
                    roots_.empty() ? "tesserad --scene-root s3://BUCKET/PREFIX"
                                   : absl::StrJoin(roots_, " or ", [](std::string* out, const Root& root) {
                                       absl::StrAppend(out, root.url);
                                     }));
}

StatusOr<Digest> StoredScenes::Hash(const std::string& url, const std::function<bool()>& cancelled) const {
  TESSERA_ASSIGN_OR_RETURN(const Place place, Find(url));
  return StreamObject(*place.client, place.key, cancelled, [](std::string_view) { return absl::OkStatus(); });
}

std::map<std::string, S3Counts> StoredScenes::counts() const {
  std::map<std::string, S3Counts> counts;
  for (const Root& root : roots_) AddCounts(root.client->counts(), &counts);
  return counts;
}

StatusOr<Digest> HashSceneFile(const std::string& path, const StoredScenes* scenes) {
  if (!IsS3Url(path)) return HashFile(path);
  if (scenes == nullptr) {
    return absl::UnavailableError(path + " cannot be read without --scene-root s3://BUCKET/PREFIX");
  }
  StatusOr<Digest> digest = scenes->Hash(path);
  if (digest.ok() || absl::IsNotFound(digest.status()) || !scenes->Find(path).ok()) return digest;
  return absl::UnavailableError(absl::StrCat(path, ": ", std::string(digest.status().message())));
}

void FetchedScene::Describe(SceneLoadOptions* options) const {
  for (const ManifestFile& file : manifest.files) {
    if (FileExists(absl::StrCat(folder, "/", file.name))) continue;  // fetched
    options->elsewhere.insert(file.name);
    if (file.image) {
      options->headers_elsewhere.emplace(file.name, *file.image);
    } else if (file.fault) {
      options->headers_elsewhere.emplace(file.name, FaultOf(file, folder + "/"));
    }
  }
  options->heads_elsewhere = heads;
}

std::string FetchedScene::Named(const std::string& message) const {
  return absl::StrReplaceAll(message, {{folder, url}});
}

Status FetchedScene::Named(const Status& error) const {
  std::vector<InputFault> faults = FaultsOf(error);
  for (InputFault& fault : faults) fault.file = Named(fault.file);
  Status named(error.code(), Named(std::string(error.message())));
  SetFaults(named, faults);
  return named;
}

StatusOr<FetchedScene> FetchScene(const StoredScenes& scenes, const std::string& url,
                                  const std::function<bool()>& cancelled) {
  const std::string place_url(absl::StripSuffix(absl::StripSuffix(url, "/scene.json"), "/"));
  TESSERA_ASSIGN_OR_RETURN(const StoredScenes::Place place, scenes.Find(place_url));
  TESSERA_ASSIGN_OR_RETURN(TempFolder scratch, TempFolder::Create(""));
  FetchedScene fetched = {place_url, std::move(scratch), "", {}};
  // A scene without a name in scene.json is named after its folder.
  fetched.folder = absl::StrCat(fetched.scratch.path(), "/", fs::path(place_url).filename().string());
  TESSERA_RETURN_IF_ERROR(EnsureFolder(fetched.folder));
  SceneFetcher fetcher(place, cancelled, &fetched);
  TESSERA_RETURN_IF_ERROR(fetcher.ReadManifest());
  TESSERA_RETURN_IF_ERROR(fetcher.ReadList());
  const ManifestFile* const scene_file = FindFile(fetched.manifest, kSceneFileName);
  if (scene_file == nullptr) return fetched;  // LoadScene says so
  if (scene_file->digest.size_bytes > kMaxSceneJsonBytes) {
    return InputError(absl::StrCat(place_url, "/", kSceneFileName), "",
                      absl::StrCat(scene_file->digest.size_bytes, " bytes"),
                      absl::StrCat("at most ", kMaxSceneJsonBytes));
  }
  TESSERA_RETURN_IF_ERROR(fetcher.Fetch(*scene_file));
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(absl::StrCat(fetched.folder, "/", kSceneFileName)));
  Faults unused;  // LoadScene finds them again
  const SceneFile scene = ParseSceneFile(text, kSceneFileName, &unused);
  for (const ScenePath* path : {&scene.cameras, &scene.images, &scene.likelihoods, &scene.masks}) {
    if (path->path != ".") continue;
    return InputError(absl::StrCat(place_url, "/", kSceneFileName), "", "'.' for a folder",
                      "a folder of its own, such as images, in a scene in an object store");
  }
  for (const ManifestFile& file : fetched.manifest.files) {
    const bool of_model = absl::StartsWith(file.name, scene.cameras.path + "/") && IsOfCameraModel(file.name);
    if (of_model && file.name != kSceneFileName) TESSERA_RETURN_IF_ERROR(fetcher.Fetch(file));
    if (file.name == scene.mesh.path) TESSERA_RETURN_IF_ERROR(fetcher.FetchHead(file));
  }
  return fetched;
}

StatusOr<SceneDescription> LoadFetchedScene(const FetchedScene& fetched, Warnings* warnings, SceneLoadOptions options) {
  fetched.Describe(&options);
  Warnings found;
  StatusOr<SceneDescription> scene = LoadScene(fetched.folder, &found, options);
  const auto& others = fetched.not_in_manifest;
  if (!others.empty()) {
    const auto shown = others.begin() + static_cast<std::ptrdiff_t>(std::min(others.size(), kShownNames));
    found.push_back(absl::StrCat(kManifestName, ": does not have ", others.size(), " files of the scene, such as ",
                                 absl::StrJoin(others.begin(), shown, ", "),
                                 ": jobs do not read them; repeat tessera upload if they are new"));
  }
  Faults faults;
  if (!scene.ok()) {
    faults.Add(fetched.Named(scene.status()));
    if (!others.empty()) faults.Add(absl::InvalidArgumentError(found.back()));
    return faults.ToStatus();
  }
  for (const std::string& file : scene->files) {
    const auto other = fetched.other_sizes.find(file);
    if (other != fetched.other_sizes.end()) faults.Add(other->second);
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  if (warnings != nullptr) {
    for (const std::string& warning : found) warnings->push_back(fetched.Named(warning));
  }
  return scene;
}

StatusOr<std::vector<NamedDigest>> DigestsOf(const SceneManifest& manifest, const std::vector<std::string>& files) {
  std::vector<NamedDigest> digests;
  for (const std::string& name : files) {
    const ManifestFile* const file = FindFile(manifest, name);
    if (file == nullptr) return absl::InternalError(absl::StrCat(kManifestName, " lacks ", name));
    digests.push_back({name, file->digest});
  }
  return digests;
}

}  // namespace tessera

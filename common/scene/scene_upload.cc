#include "common/scene/scene_upload.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr size_t kFilesAtOnce = 8;
constexpr char kSceneJson[] = "scene.json";
constexpr std::chrono::milliseconds kReportEvery{200};

Status CheckHasSceneJson(const SceneManifest& manifest, const std::string& place) {
  const bool has = std::any_of(manifest.files.begin(), manifest.files.end(),
                               [](const ManifestFile& file) { return file.name == kSceneJson; });
  if (has) return absl::OkStatus();
  return InputError(absl::StrCat(place, "/", kSceneJson), "", "no such file", "a scene, which has a scene.json");
}

// Calls `work` for all files, several at once, large ones first, until one fails. Reports done_bytes() / bytes.
Status ForEachFile(SceneManifest* manifest, int64_t bytes, const std::function<int64_t()>& done_bytes,
                   const std::string& stage, const TaskControl& control,
                   const std::function<Status(ManifestFile*)>& work) {
  std::vector<ManifestFile*> order;
  for (ManifestFile& file : manifest->files) order.push_back(&file);
  std::stable_sort(order.begin(), order.end(), [](const ManifestFile* a, const ManifestFile* b) {
    return a->digest.size_bytes > b->digest.size_bytes;
  });
  std::mutex mutex;
  std::condition_variable ended;
  size_t next = 0, running = std::min(kFilesAtOnce, order.size());
  Status status;
  const auto run = [&] {
    std::unique_lock lock(mutex);
    while (status.ok() && next < order.size()) {
      ManifestFile* const file = order[next++];
      lock.unlock();
      Status result = control.Check();
      if (result.ok()) result = work(file);
      lock.lock();
      if (status.ok()) status = result;
    }
    --running;
    ended.notify_all();
  };
  std::vector<std::thread> threads;
  for (size_t i = running; i > 0; --i) threads.emplace_back(run);
  {
    std::unique_lock lock(mutex);
    while (!ended.wait_for(lock, kReportEvery, [&] { return running == 0; })) {
      const size_t finished = next - std::min(next, running);
      lock.unlock();
      const double fraction = static_cast<double>(done_bytes()) / static_cast<double>(std::max<int64_t>(bytes, 1));
      control.Report(std::min(fraction, 1.0), absl::StrCat(stage, ", ", finished, " of ", order.size(), " files"));
      lock.lock();
    }
  }
  for (std::thread& thread : threads) thread.join();
  return status;
}

int64_t BytesOf(const SceneManifest& manifest) {
  int64_t bytes = 0;
  for (const ManifestFile& file : manifest.files) bytes += file.digest.size_bytes;
  return bytes;
}

// 0 if it cannot be read.
int64_t ModifiedNs(const std::string& path) {
  struct stat info;
  if (::stat(path.c_str(), &info) != 0) return 0;
  return int64_t{info.st_mtim.tv_sec} * 1'000'000'000 + info.st_mtim.tv_nsec;
}

StatusOr<SceneUpload> StoreManifest(S3Client& client, SceneManifest manifest, int64_t sent_files) {
  const std::string text = ToJson(manifest);
  TESSERA_RETURN_IF_ERROR(client.Put(kManifestName, text, Sha256Hex(text)));
  const int64_t bytes = BytesOf(manifest);
  return SceneUpload{std::move(manifest), bytes, sent_files};
}

// Reads an object of the store, hashes it and reads the header of an image.
Status Describe(S3Client& client, const std::string& scratch_file, const TaskControl& control,
                std::atomic<int64_t>* read_bytes, ManifestFile* file) {
  Sha256Hasher hasher;
  int64_t size = 0;
  int fd = -1;
  const auto copy_if_image = [&](std::string_view head) -> Status {
    if (fd >= 0 || !MayBeImage(file->name, head)) return absl::OkStatus();
    fd = ::open(scratch_file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    return fd < 0 ? FileError(errno, "cannot write " + scratch_file) : absl::OkStatus();
  };
  TESSERA_RETURN_IF_ERROR(copy_if_image(""));
  const Status status = client.Stream(file->name, 0, [&](std::string_view bytes) -> Status {
    TESSERA_RETURN_IF_ERROR(control.Check());
    if (size == 0) TESSERA_RETURN_IF_ERROR(copy_if_image(bytes));
    hasher.Update(bytes.data(), bytes.size());
    size += static_cast<int64_t>(bytes.size());
    *read_bytes += static_cast<int64_t>(bytes.size());
    return fd < 0 ? absl::OkStatus() : WriteAll(fd, bytes, "cannot write " + scratch_file);
  });
  if (fd >= 0) ::close(fd);
  if (status.ok()) {
    file->digest = {hasher.Finish(), size};
    if (fd >= 0) ReadImageFacts(scratch_file, file);
  }
  if (fd >= 0) ::unlink(scratch_file.c_str());
  return status;
}

}  // namespace

StatusOr<SceneUpload> UploadScene(const std::string& folder, S3Client& client, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(std::vector<std::string> names, ListFiles(folder));
  std::erase_if(names, [](const std::string& name) { return !IsPartOfScene(name); });
  SceneManifest manifest;
  for (const std::string& name : names) {
    TESSERA_RETURN_IF_ERROR(CheckS3Key(client.location().prefix + name));
    TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, StampOf(absl::StrCat(folder, "/", name)));
    manifest.files.push_back({name, {"", stamp.size_bytes}});
  }
  TESSERA_RETURN_IF_ERROR(CheckHasSceneJson(manifest, folder));
  const auto sent_bytes = [&client] {
    const auto counts = client.counts();
    const auto put = counts.find("put");
    return put == counts.end() ? 0 : put->second.sent_bytes;
  };
  std::atomic<int64_t> skipped_bytes{0}, sent_files{0};
  TESSERA_RETURN_IF_ERROR(ForEachFile(
      &manifest, BytesOf(manifest), [&] { return skipped_bytes + sent_bytes(); }, "sending", control,
      [&](ManifestFile* file) -> Status {
        const std::string path = absl::StrCat(folder, "/", file->name);
        TESSERA_ASSIGN_OR_RETURN(file->digest, HashFile(path));
        ReadImageFacts(path, file);
        if (IsOfCameraModel(file->name)) file->modified_ns = ModifiedNs(path);
        const StatusOr<S3Object> object = client.Head(file->name);
        if (object.ok() && object->size_bytes == file->digest.size_bytes && object->sha256 == file->digest.sha256) {
          skipped_bytes += file->digest.size_bytes;
          return absl::OkStatus();
        }
        if (!object.ok() && !absl::IsNotFound(object.status())) return object.status();
        ++sent_files;
        return client.PutFile(file->name, path, file->digest.size_bytes, file->digest.sha256);
      }));
  return StoreManifest(client, std::move(manifest), sent_files);
}

StatusOr<SceneUpload> DescribeStoredScene(S3Client& client, const std::string& scratch, const TaskControl& control) {
  SceneManifest manifest;
  S3Page page;
  do {
    TESSERA_ASSIGN_OR_RETURN(page, client.List("", page.next));
    TESSERA_RETURN_IF_ERROR(control.Check());
    for (const S3Object& object : page.objects) {
      if (!IsPartOfScene(object.key)) continue;
      ManifestFile& file = manifest.files.emplace_back(ManifestFile{object.key, {"", object.size_bytes}});
      if (IsOfCameraModel(object.key)) file.modified_ns = object.modified_us * 1000;
    }
  } while (!page.next.empty());
  TESSERA_RETURN_IF_ERROR(CheckHasSceneJson(manifest, ToText(client.location())));
  std::atomic<int64_t> read_bytes{0}, number{0};
  TESSERA_RETURN_IF_ERROR(ForEachFile(
      &manifest, BytesOf(manifest), [&] { return read_bytes.load(); }, "reading", control,
      [&](ManifestFile* file) {
        return Describe(client, absl::StrCat(scratch, "/image-", ++number), control, &read_bytes, file);
      }));
  return StoreManifest(client, std::move(manifest), 0);
}

}  // namespace tessera

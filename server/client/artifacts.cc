#include "server/client/artifacts.h"

#include <algorithm>
#include <filesystem>
#include <set>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_parameters.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "common/storage/temporary_name.h"
#include "common/storage/zip_file.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr int64_t kMaxArchiveBytes = int64_t{4} << 30;

struct Artifact {
  std::string path;  // destination
  Digest digest;
};

// A file of an archive.
struct UnpackedFile {
  std::string from, path;  // where it was unpacked, and its destination
};

bool IsSheetArchive(const std::string& path) { return path.ends_with(kSheetArchiveEnding); }

// Unpacks the archive to `folder`. INVALID_ARGUMENT for names that lead out of it, and as ZipFile.
Status Unpack(const Artifact& artifact, const FolderBlobs& store, const std::string& folder,
              std::vector<UnpackedFile>* files) {
  TESSERA_ASSIGN_OR_RETURN(std::string bytes, store.Read(artifact.digest, kMaxArchiveBytes));
  TESSERA_ASSIGN_OR_RETURN(ZipFile zip, ZipFile::Parse(std::move(bytes), artifact.path));
  const std::string destination = std::filesystem::path(artifact.path).parent_path().string();
  for (const std::string& member : zip.members()) {
    UnpackedFile& file = files->emplace_back();
    TESSERA_ASSIGN_OR_RETURN(file.from, JoinInside(folder, member));
    TESSERA_ASSIGN_OR_RETURN(file.path, JoinInside(destination, member));
    TESSERA_ASSIGN_OR_RETURN(const std::string content, zip.Read(member, kMaxArchiveBytes));
    TESSERA_RETURN_IF_ERROR(EnsureFolder(std::filesystem::path(file.from).parent_path().string()));
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(file.from, content));
  }
  return absl::OkStatus();
}

Status MoveInto(const std::string& from, const std::string& path) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(std::filesystem::path(path).parent_path().string()));
  return RenameDurably(from, path);
}

}  // namespace

Status TakeArtifacts(Connection& connection, const std::string& prefix, v1::Job* job) {
  if (job->artifacts_size() < job->artifacts_total()) {
    v1::ListArtifactsResponse all;
    TESSERA_RETURN_IF_ERROR(connection.ListArtifacts(job->name(), prefix, &all));
    job->mutable_artifacts()->Swap(all.mutable_artifacts());
  } else {
    auto& artifacts = *job->mutable_artifacts();
    artifacts.erase(std::remove_if(artifacts.begin(), artifacts.end(),
                                   [&](const v1::Artifact& each) { return !each.name().starts_with(prefix); }),
                    artifacts.end());
  }
  job->set_artifacts_total(job->artifacts_size());
  return absl::OkStatus();
}

StatusOr<std::vector<std::string>> FetchArtifacts(Connection& connection, const v1::Job& job, const std::string& out,
                                                  const std::string& staging, const TaskControl& control) {
  std::vector<Artifact> artifacts, archives;
  for (const v1::Artifact& artifact : job.artifacts()) {
    TESSERA_ASSIGN_OR_RETURN(const std::string path, JoinInside(out, artifact.name()));
    std::vector<Artifact>& list = IsSheetArchive(path) ? archives : artifacts;
    list.push_back({path, {artifact.digest().sha256(), artifact.digest().size_bytes()}});
  }
  const std::string mesh = out + "/mesh.ply";
  std::stable_sort(artifacts.begin(), artifacts.end(),
                   [&](const Artifact& a, const Artifact& b) { return (a.path == mesh) < (b.path == mesh); });
  std::vector<std::string> written;
  {
    TESSERA_ASSIGN_OR_RETURN(const auto store, FolderBlobs::Open(staging));
    for (const std::vector<Artifact>* list : {&archives, &artifacts}) {
      for (const Artifact& artifact : *list) {
        TESSERA_RETURN_IF_ERROR(connection.blobs().Fetch(artifact.digest, *store, control));
        TESSERA_RETURN_IF_ERROR(store->Verify(artifact.digest));  // an earlier call may have left it
      }
    }
    std::vector<UnpackedFile> unpacked;
    for (size_t i = 0; i < archives.size(); ++i) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      TESSERA_RETURN_IF_ERROR(Unpack(archives[i], *store, absl::StrCat(staging, "/unpacked/", i), &unpacked));
    }
    std::set<std::string> paths;
    for (const UnpackedFile& file : unpacked) {
      if (paths.insert(file.path).second) continue;
      return absl::DataLossError(absl::StrCat(job.name(), ": two exported files have the name ", file.path));
    }
    // All files are complete: from here on only renames and copies.
    for (const UnpackedFile& file : unpacked) {
      TESSERA_RETURN_IF_ERROR(MoveInto(file.from, file.path));
      written.push_back(file.path);
    }
    for (size_t i = 0; i < artifacts.size(); ++i) {
      const Artifact& artifact = artifacts[i];
      TESSERA_RETURN_IF_ERROR(EnsureFolder(std::filesystem::path(artifact.path).parent_path().string()));
      const auto same = std::find_if(artifacts.begin(), artifacts.begin() + static_cast<std::ptrdiff_t>(i),
                                     [&](const Artifact& other) { return other.digest == artifact.digest; });
      if (&*same != &artifact) {  // moved out of the store already
        const std::string temporary = TemporaryBeside(artifact.path);
        TESSERA_RETURN_IF_ERROR(CopyFileDurably(same->path, temporary));
        TESSERA_RETURN_IF_ERROR(RenameDurably(temporary, artifact.path));
      } else {
        TESSERA_RETURN_IF_ERROR(store->MoveTo(artifact.digest, artifact.path));
      }
      written.push_back(artifact.path);
    }
  }
  TESSERA_RETURN_IF_ERROR(RemoveTree(staging));
  return written;
}

}  // namespace tessera

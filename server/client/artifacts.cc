#include "server/client/artifacts.h"

#include <algorithm>
#include <filesystem>

#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "common/storage/temporary_name.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct Artifact {
  std::string path;  // destination
  Digest digest;
};

}  // namespace

StatusOr<std::vector<std::string>> FetchArtifacts(Connection& connection, const v1::Job& job, const std::string& out,
                                                  const std::string& staging, const TaskControl& control) {
  std::vector<Artifact> artifacts;
  for (const v1::Artifact& artifact : job.artifacts()) {
    TESSERA_ASSIGN_OR_RETURN(const std::string path, JoinInside(out, artifact.name()));
    artifacts.push_back({path, {artifact.digest().sha256(), artifact.digest().size_bytes()}});
  }
  const std::string mesh = out + "/mesh.ply";
  std::stable_sort(artifacts.begin(), artifacts.end(),
                   [&](const Artifact& a, const Artifact& b) { return (a.path == mesh) < (b.path == mesh); });
  std::vector<std::string> written;
  {
    TESSERA_ASSIGN_OR_RETURN(const auto store, FolderBlobs::Open(staging));
    for (const Artifact& artifact : artifacts) {
      TESSERA_RETURN_IF_ERROR(connection.blobs().Fetch(artifact.digest, *store, control));
      TESSERA_RETURN_IF_ERROR(store->Verify(artifact.digest));  // an earlier call may have left it
    }
    // All files are complete: from here on only renames and copies.
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

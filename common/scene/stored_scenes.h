// Scenes in an S3 store, for a coordinator: it reads the manifest, scene.json and the camera model, and no pixels.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/s3/s3_client.h"
#include "common/scene/manifest.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {

// Where scenes may be read. Files have names s3://BUCKET/PREFIX/NAME. Thread-safe.
class StoredScenes {
 public:
  // `roots`: s3://BUCKET/PREFIX. `endpoint` and `region` as of ParseS3Url. `credentials` and `clock` must outlive this.
  // INVALID_ARGUMENT for a malformed root.
  static StatusOr<std::unique_ptr<StoredScenes>> Open(const std::vector<std::string>& roots,
                                                      const std::string& endpoint, const std::string& region,
                                                      S3CredentialsSource* credentials, const Clock* clock,
                                                      const S3ClientOptions& options);

  struct Place {
    S3Client* client;
    std::string key;
  };
  // The client of the root that contains the file. INVALID_ARGUMENT if it is in none.
  StatusOr<Place> Find(const std::string& url) const;
  // Of a file; errors of Find and S3Client. CANCELLED by `cancelled`, which may be empty.
  StatusOr<Digest> Hash(const std::string& url, const std::function<bool()>& cancelled = {}) const;

  // By method, of all roots.
  std::map<std::string, S3Counts> counts() const;

 private:
  struct Root {
    std::string url;  // without a slash at its end
    std::unique_ptr<S3Client> client;
  };
  std::vector<Root> roots_;
};

// Hashes a file of a scene: a path, or a URL in `scenes`, which may be null. Errors are those of a missing or changed
// file, also for a URL that is in no root; UNAVAILABLE if the store does not answer or there is no store.
StatusOr<Digest> HashSceneFile(const std::string& path, const StoredScenes* scenes);

// A scene in a store, and the files that its description needs, in a local folder.
struct FetchedScene {
  std::string url;  // s3://BUCKET/PREFIX, without a slash at its end
  TempFolder scratch;
  std::string folder;                              // in `scratch`: has scene.json and the files of the camera model
  SceneManifest manifest;                          // without files that the store lacks
  std::map<std::string, std::string> heads = {};   // SceneLoadOptions::heads_elsewhere
  std::map<std::string, Status> other_sizes = {};  // faults of objects with another size than in the manifest, by name
  std::vector<std::string> not_in_manifest = {};   // objects that the manifest lacks

  // Sets what is elsewhere.
  void Describe(SceneLoadOptions* options) const;
  // The text, or the error with its faults, with the URL in place of the local folder.
  std::string Named(const std::string& message) const;
  Status Named(const Status& error) const;
};

// Reads the manifest, lists the objects, and fetches what LoadScene opens. INVALID_ARGUMENT without a manifest, for a
// faulty one, and for a fetched file whose hash differs from the manifest's. Errors of S3Client. CANCELLED.
StatusOr<FetchedScene> FetchScene(const StoredScenes& scenes, const std::string& url,
                                  const std::function<bool()>& cancelled);

// LoadScene of a fetched scene. Messages name the URL. Faults of the store against the manifest are errors if the scene
// has such a file; objects that the manifest lacks are a warning.
StatusOr<SceneDescription> LoadFetchedScene(const FetchedScene& fetched, Warnings* warnings, SceneLoadOptions options);

// The digests of `files`, names of the scene, as the manifest has them. INTERNAL if it lacks one.
StatusOr<std::vector<NamedDigest>> DigestsOf(const SceneManifest& manifest, const std::vector<std::string>& files);

}  // namespace tessera

// What a coordinator opens at its start: its blob store, a folder or a bucket of an S3 store, and where scenes are.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_credentials.h"
#include "common/s3_blobs/blob_transfers.h"
#include "common/s3_blobs/s3_blobs.h"
#include "common/scene/stored_scenes.h"
#include "common/storage/blob_store.h"

namespace tessera {

// Options of the command line.
struct BlobFlags {
  std::string url;  // a folder or s3://BUCKET/PREFIX; empty: DATA/blobs
  // Of the S3 store of blobs and scenes.
  std::string endpoint;  // empty: Amazon's
  std::string region = "us-east-1";
  std::string ca_file;
};

struct OpenedBlobs {
  // Null unless the store is in S3.
  std::unique_ptr<S3CredentialsSource> credentials;
  std::unique_ptr<S3Client> client, remover;
  std::unique_ptr<BlobTransfers> transfers;

  std::unique_ptr<BlobStore> store;
  std::string folder;  // of the blobs; empty unless the store is a folder

  // Counts of the requests to the S3 store. Empty if there is none.
  std::function<std::map<std::string, S3Counts>()> counts;
};

// Opens the store. Credentials of an S3 store come from where AWS's tools read them. `grace_s`: age below which no blob
// is removed. `clock` must outlive the store.
StatusOr<OpenedBlobs> OpenBlobs(const BlobFlags& flags, const std::string& data, double grace_s, const Clock* clock);

// Scenes in the S3 store, and the credentials that they are read with.
struct OpenedScenes {
  std::unique_ptr<S3CredentialsSource> credentials;
  std::unique_ptr<StoredScenes> scenes;  // null: none of the roots is in a store
};

// `roots`: folders and URLs, s3://BUCKET/PREFIX. INVALID_ARGUMENT for a malformed one. `clock` must outlive the result.
StatusOr<OpenedScenes> OpenStoredScenes(const std::vector<std::string>& roots, const BlobFlags& flags,
                                        const Clock* clock);

// Finds out which uploads the S3 store takes, logs it, and sets `transfers`. Nothing for a folder. Call before serving.
Status OpenTransfers(OpenedBlobs& blobs, const std::string& data);

}  // namespace tessera

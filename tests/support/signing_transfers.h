// Signs URLs for reading blobs of a store that no test reaches.
#pragma once

#include <memory>
#include <optional>

#include "common/base/clock.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_credentials.h"
#include "common/s3_blobs/blob_transfers.h"

namespace tessera {

struct SigningTransfers {
  SystemClock clock;
  std::unique_ptr<S3CredentialsSource> credentials = FixedS3Credentials({"key", "secret", "", 0});
  std::unique_ptr<S3Client> client = *S3Client::Create(
      {.endpoint = "http://127.0.0.1:1", .bucket = "bucket", .prefix = "city/"}, credentials.get(), &clock);
  BlobTransfers transfers{client.get(), nullptr, SignedHash::kContent};
};

}  // namespace tessera

// A bucket of the S3 store that ctest starts (tests/support/servers/start-radosgw). Use TESSERA_NEED_SERVER("radosgw")
// first.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "common/base/clock.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_credentials.h"
#include "common/storage/temporary_name.h"
#include "tests/support/servers/test_server.h"

namespace tessera {

// A new, empty prefix.
inline S3Location NewTestLocation() {
  return {.endpoint = ServerAddress("radosgw"), .bucket = "tests", .prefix = UniqueName() + "/"};
}

inline S3Credentials TestCredentials() {
  S3Credentials credentials;
  credentials.access_key = ServerFile("radosgw", "access-key");
  credentials.secret_key = ServerFile("radosgw", "secret-key");
  return credentials;
}

// A client with all that it needs.
struct TestS3 {
  explicit TestS3(S3ClientOptions options = {}, const S3Location& at = NewTestLocation()) : location(at) {
    auto made = S3Client::Create(location, credentials.get(), &clock, options);
    EXPECT_TRUE(made.ok()) << made.status();
    client = *std::move(made);
  }

  S3Location location;
  SystemClock clock;
  std::unique_ptr<S3CredentialsSource> credentials = FixedS3Credentials(TestCredentials());
  std::unique_ptr<S3Client> client;
};

}  // namespace tessera

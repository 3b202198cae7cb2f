// Where a bucket of an S3 store is.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

struct S3Location {
  std::string endpoint;              // http://HOST[:PORT] or https://HOST[:PORT], without a path and a default port
  std::string region = "us-east-1";  // that requests are signed for
  std::string bucket;
  std::string prefix;  // of all keys: empty, or ends with a slash
};

// Whether `url` begins with s3://.
bool IsS3Url(const std::string& url);

// Reads s3://BUCKET[/PREFIX]. An empty endpoint is that of Amazon in the region. INVALID_ARGUMENT names what is wrong.
StatusOr<S3Location> ParseS3Url(const std::string& url, const std::string& endpoint, const std::string& region);

// INVALID_ARGUMENT unless the whole key, with the prefix, may be used: 1 to 1,024 bytes of UTF-8 without control
// characters, without empty parts, "." and ".." between slashes.
Status CheckS3Key(const std::string& key);

// s3://BUCKET/PREFIX, for messages.
std::string ToText(const S3Location& location);

}  // namespace tessera

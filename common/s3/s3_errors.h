// Errors of S3 stores as statuses.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/s3/http_client.h"
#include "common/s3/s3_answers.h"

namespace tessera {

// The request that failed.
struct S3ErrorContext {
  std::string object;                // "s3://bucket/key", for the message
  int64_t unix_us = 0;               // when it was signed; 0: not known
  std::vector<std::string> secrets;  // removed from the message, if the store repeats them
  bool signed_url = false;           // a signed URL was refused: PERMISSION_DENIED, whatever the reason
};

// The status of an answer that is not 2xx, as listed at S3Client. A transient one is UNAVAILABLE, with the delay that
// the store asks for (RetryDelayOf).
Status S3ErrorOf(const HttpAnswer& answer, const S3ErrorContext& context);
// The same for an error in the body of an answer with status 200.
Status S3ErrorOf(const S3ErrorAnswer& error, int http_status, const HttpAnswer& answer, const S3ErrorContext& context);

// "2013-05-24 00:00:00 UTC".
std::string S3TimeText(int64_t unix_us);

}  // namespace tessera

// Parsers of the XML with which S3 stores answer. The text is untrusted: a store may be wrong, or another server.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/s3/s3_client.h"

namespace tessera {

// All functions return INVALID_ARGUMENT with the place in the XML for text that is no such answer.

// An error. `code` is never empty.
struct S3ErrorAnswer {
  std::string code, message;
  std::string server_time;  // of RequestTimeTooSkewed; else empty
  std::string region;       // that the request should be signed for, or empty
  std::string endpoint;     // that the request should be sent to, or empty
};
StatusOr<S3ErrorAnswer> ParseS3Error(const std::string& xml);
// The error in the body of an answer with status 200, as of copying and completing; nullopt if it is none.
std::optional<S3ErrorAnswer> S3ErrorIn(const std::string& xml);

// ListObjectsV2. Keys with the location's prefix.
StatusOr<S3Page> ParseS3Listing(const std::string& xml);

struct S3UploadPage {
  std::vector<S3Upload> uploads;
  std::string next_key, next_id;  // of the next page; both empty: this was the last
};
StatusOr<S3UploadPage> ParseS3Uploads(const std::string& xml);

// CreateMultipartUpload: the id.
StatusOr<std::string> ParseS3UploadId(const std::string& xml);

// CopyObject, UploadPartCopy and CompleteMultipartUpload: the ETag, without quotes.
StatusOr<std::string> ParseS3EtagOf(const std::string& root, const std::string& xml);

// DeleteObjects: the objects that could not be deleted.
struct S3DeleteError {
  std::string key, code, message;
};
StatusOr<std::vector<S3DeleteError>> ParseS3DeleteErrors(const std::string& xml);

// Removes quotes and the W/ of weak ones. Nullopt if the ETag is empty or has characters that no header may have.
std::optional<std::string> ParseEtag(const std::string& text);

// Text as content of an element, for requests. `text` has no control characters (CheckS3Key).
std::string EscapeS3Xml(const std::string& text);

}  // namespace tessera

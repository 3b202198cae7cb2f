// XML with which an S3 store answers.
#pragma once

#include <string>

#include "common/s3/s3_answers.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Gives `bytes` to all parsers; aborts if one breaks its promises. True if one took it.
inline bool RunS3AnswersTarget(const std::string& bytes) {
  bool taken = false;
  const auto check = [&](const auto& parsed) {
    taken = taken || parsed.ok();
    if (!parsed.ok()) RequireRefusal(parsed.status());
    return parsed.ok();
  };
  const auto error = ParseS3Error(bytes);
  if (check(error)) Require(!error->code.empty(), "an error has a code");
  const auto listing = ParseS3Listing(bytes);
  if (check(listing)) {
    for (const S3Object& object : listing->objects) {
      Require(!object.key.empty() && object.size_bytes >= 0, "an object has a key and a size");
      Require(ParseEtag(object.etag) == object.etag, "an ETag may be sent in a header");
    }
  }
  const auto uploads = ParseS3Uploads(bytes);
  if (check(uploads)) {
    for (const S3Upload& upload : uploads->uploads) Require(!upload.id.empty(), "an upload has an id");
  }
  const auto id = ParseS3UploadId(bytes);
  if (check(id)) Require(!id->empty(), "an upload has an id");
  for (const char* root : {"CopyObjectResult", "CopyPartResult", "CompleteMultipartUploadResult"}) {
    const auto etag = ParseS3EtagOf(root, bytes);
    if (check(etag)) Require(ParseEtag(*etag) == *etag, "an ETag may be sent in a header");
  }
  check(ParseS3DeleteErrors(bytes));
  return taken;
}

}  // namespace tessera

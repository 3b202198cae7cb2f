// Client of an S3 store (AWS, Ceph radosgw, Swift, MinIO): the requests that blobs and scenes need, signed by libcurl.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/clock.h"
#include "common/base/retry/retry.h"
#include "common/base/status.h"
#include "common/s3/s3_credentials.h"
#include "common/s3/s3_location.h"

namespace tessera {

// An object of the bucket. Keys are relative to the location's prefix in all calls.
struct S3Object {
  std::string key;
  int64_t size_bytes = 0;
  int64_t modified_us = 0;  // Unix time
  std::string etag;         // without quotes
  // Head: the SHA-256 of the content, as PutFile wrote it beside the object (x-amz-meta-sha256). Empty: not known, as
  // of objects that others stored or that were copied.
  std::string sha256 = {};
};

struct S3Page {
  std::vector<S3Object> objects;
  std::string next;  // of the next page; empty: this was the last
};

// A multipart upload that was neither completed nor aborted.
struct S3Upload {
  std::string key, id;
  int64_t started_us = 0;  // Unix time
};

// Counts of one method, for metrics.
struct S3Counts {
  int64_t calls = 0;  // attempts
  int64_t retries = 0, errors = 0;
  int64_t sent_bytes = 0, received_bytes = 0;
  double seconds = 0;
};

// Adds the counts to those of the same methods in `sum`.
void AddCounts(const std::map<std::string, S3Counts>& counts, std::map<std::string, S3Counts>* sum);

struct S3PutCondition {
  // If-None-Match: *; FAILED_PRECONDITION if the key exists. A request that is repeated because its answer was lost may
  // find its own object.
  bool only_if_absent = false;
};

// A request that the holder of the URL may make without credentials.
struct SignedRequest {
  std::string method;  // GET or PUT
  std::string url;
  std::map<std::string, std::string> headers;  // must be sent as they are: they are signed
};

// How the URL of an upload names the hash of its content. Stores differ in what they enforce.
enum class SignedHash {
  kNone,      // not at all
  kContent,   // header x-amz-content-sha256 (AWS, radosgw)
  kChecksum,  // header x-amz-checksum-sha256 (AWS); radosgw and Swift ignore it
};

struct S3ClientOptions {
  std::string ca_file;    // PEM; empty: the system's authorities
  double connect_s = 10;  // limit of a connection's setup
  double silence_s = 30;  // a request that moves less than 100 bytes a second for this time is ended and retried
  RetryPolicy retry = {.max_attempts = 8, .first_delay_s = 0.2, .max_delay_s = 10};
  Sleeper sleeper = RealSleeper();    // returns false to cancel
  int64_t max_put_bytes = 64 << 20;   // larger files are sent in parts
  int64_t min_part_bytes = 16 << 20;  // of a file; larger if 10,000 parts would not suffice
  int parts_at_once = 4;
};

// Every request is signed with the hash of its content (x-amz-content-sha256). Repeats a request after 5xx, 429, a lost
// connection and silence, with growing delays and jitter; all requests may be repeated. Thread-safe: connections are
// kept and shared.
//
// Errors, in words, with the store's own code and message: NOT_FOUND (no such key), FAILED_PRECONDITION (a condition
// was not met; no such bucket; credentials refused; the clocks differ, with both times), PERMISSION_DENIED,
// RESOURCE_EXHAUSTED (a quota or the store is full), DATA_LOSS (content and hash differ), UNAVAILABLE (after the last
// attempt), INTERNAL (an answer that is not S3's), INVALID_ARGUMENT (any other 4xx, a wrong key). CANCELLED by the
// sleeper. Errors of local files as of files.h. No secret or signature is in any message.
class S3Client {
 public:
  // `credentials` and `clock` must outlive the client. INVALID_ARGUMENT for files that cannot be read.
  static StatusOr<std::unique_ptr<S3Client>> Create(const S3Location& location, S3CredentialsSource* credentials,
                                                    const Clock* clock, const S3ClientOptions& options = {});
  ~S3Client();

  const S3Location& location() const;

  StatusOr<S3Object> Head(const std::string& key);
  // Up to `size_bytes` bytes from `offset_bytes`; fewer only at the end of the object.
  StatusOr<std::string> Get(const std::string& key, int64_t offset_bytes, int64_t size_bytes);
  // Passes the bytes from `offset_bytes` to the object's end to `take`, in order, each once: an interrupted transfer
  // goes on where it stopped, if the object's ETag is still the same (else ABORTED). Errors of `take` end the transfer.
  Status Stream(const std::string& key, int64_t offset_bytes,
                const std::function<Status(std::string_view bytes)>& take);

  // `sha256`: of the bytes, lower-case hex.
  Status Put(const std::string& key, std::string_view bytes, const std::string& sha256, S3PutCondition condition = {});
  // A local file; in parts, several at once, if it is larger than S3ClientOptions::max_put_bytes. DATA_LOSS if its
  // content does not hash to `sha256` or has another size; nothing is stored then.
  Status PutFile(const std::string& key, const std::string& path, int64_t size_bytes, const std::string& sha256);
  // Sets the object's time to now by copying it onto itself, in parts if it has more than 5 GiB. NOT_FOUND if it does
  // not exist.
  Status Renew(const std::string& key);
  Status Copy(const std::string& from, const std::string& to);

  // Objects whose keys begin with `key_prefix`, in ascending order of the keys' bytes, at most 1,000. `from`:
  // S3Page::next of the page before.
  StatusOr<S3Page> List(const std::string& key_prefix, const std::string& from = "");
  // Deletes the keys, in batches of 1,000. Missing ones are no error.
  Status Delete(const std::vector<std::string>& keys);

  // --- Multipart uploads of others: the coordinator opens and closes what a worker sends by signed URLs. ---
  // `sha256`: S3Object::sha256 of the object; may be empty.
  StatusOr<std::string> StartUpload(const std::string& key, const std::string& sha256 = "");
  // `etags` of the parts, from part 1 on.
  Status CompleteUpload(const std::string& key, const std::string& id, const std::vector<std::string>& etags);
  Status AbortUpload(const std::string& key, const std::string& id);
  // At most 10,000.
  StatusOr<std::vector<S3Upload>> ListUploads(const std::string& key_prefix);

  // --- Signed URLs (AWS Signature Version 4, query form), valid for `seconds` (up to a week), but not longer than the
  // credentials. ---
  StatusOr<SignedRequest> SignGet(const std::string& key, double seconds);
  // The URL of an upload of the content with this SHA-256, as far as the store enforces `hash`, and of this size. (The
  // size is signed, too, because radosgw does not compare the hash of an empty body.)
  StatusOr<SignedRequest> SignPut(const std::string& key, const std::string& sha256, int64_t size_bytes, double seconds,
                                  SignedHash hash = SignedHash::kContent);
  StatusOr<SignedRequest> SignPart(const std::string& key, const std::string& upload, int part,
                                   const std::string& sha256, int64_t size_bytes, double seconds,
                                   SignedHash hash = SignedHash::kContent);

  // By method ("get", "put", "head", "list", "delete", "copy", "upload").
  std::map<std::string, S3Counts> counts() const;

 private:
  struct Impl;
  explicit S3Client(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Makes a signed request: no credentials are needed. Errors, retries and threads as of S3Client; an expired URL is
// PERMISSION_DENIED.
class SignedTransfers {
 public:
  explicit SignedTransfers(const S3ClientOptions& options = {});
  ~SignedTransfers();

  // Passes the object's bytes from `offset_bytes` on to `take`, as S3Client::Stream.
  Status Get(const SignedRequest& request, int64_t offset_bytes,
             const std::function<Status(std::string_view bytes)>& take);
  // Sends bytes [offset, offset + size) of a local file. Returns the ETag. DATA_LOSS for another size than the signed
  // one. `progress` (may be empty) is called with the bytes sent by the current attempt; its error ends the transfer.
  StatusOr<std::string> Put(const SignedRequest& request, const std::string& path, int64_t offset_bytes,
                            int64_t size_bytes, const std::function<Status(int64_t sent_bytes)>& progress = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

// Multipart uploads and copies of S3Client.
#include <fcntl.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "common/s3/s3_answers.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_client_impl.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr int64_t kMaxParts = 10'000;                // of S3
constexpr int64_t kMaxCopyBytes = int64_t{5} << 30;  // of S3
constexpr int64_t kCopyPartBytes = int64_t{1} << 30;
constexpr int64_t kMaxObjectBytes = int64_t{5} << 40;  // of S3
constexpr int64_t kReadBytes = 1 << 20;

class OpenedFile {
 public:
  explicit OpenedFile(const std::string& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~OpenedFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  OpenedFile(const OpenedFile&) = delete;
  OpenedFile& operator=(const OpenedFile&) = delete;
  int fd() const { return fd_; }

 private:
  const int fd_;
};

// The ETag of an object that was uploaded in parts, by the rule that AWS, radosgw and Swift follow: the MD5 of the
// parts' MD5s, and their number. Empty if a part's ETag is no MD5.
std::string EtagOfParts(const std::vector<std::string>& etags) {
  std::string digests;
  for (const std::string& etag : etags) {
    if (etag.size() != 32 || etag.find_first_not_of("0123456789abcdefABCDEF") != std::string::npos) return "";
    digests += absl::HexStringToBytes(etag);
  }
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_Digest(digests.data(), digests.size(), digest, &size, EVP_md5(), nullptr);
  return absl::StrCat(absl::BytesToHexString({reinterpret_cast<const char*>(digest), size}), "-", etags.size());
}

struct FilePart {
  int number = 0;  // from 1 on
  HttpBody body;
  std::string sha256;
};

// Parts that are hashed and wait to be sent. Ends at the first error.
class PartQueue {
 public:
  PartQueue(size_t parts, size_t max_waiting) : etags_(parts), max_waiting_(max_waiting) {}

  // False after an error.
  bool Push(FilePart part) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return waiting_.size() < max_waiting_ || !status_.ok(); });
    if (!status_.ok()) return false;
    waiting_.push_back(std::move(part));
    changed_.notify_all();
    return true;
  }
  void Close(const Status& status) {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    if (status_.ok()) status_ = status;
    changed_.notify_all();
  }
  // Sends parts until none is left.
  template <class Put>
  void Work(const Put& put) {
    while (true) {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return !waiting_.empty() || closed_ || !status_.ok(); });
      if (waiting_.empty() || !status_.ok()) return;
      const FilePart part = std::move(waiting_.front());
      waiting_.pop_front();
      changed_.notify_all();
      lock.unlock();
      StatusOr<std::string> etag = put(part);
      lock.lock();
      if (etag.ok()) {
        etags_[static_cast<size_t>(part.number) - 1] = *std::move(etag);
      } else if (status_.ok()) {
        status_ = etag.status();
      }
      changed_.notify_all();
    }
  }
  // After all threads have ended.
  StatusOr<std::vector<std::string>> Etags() const {
    if (!status_.ok()) return status_;
    return etags_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<FilePart> waiting_;
  std::vector<std::string> etags_;
  const size_t max_waiting_;
  bool closed_ = false;
  Status status_;
};

// Hashes the file once, and each part on the way, and passes the parts to `queue`.
Status HashParts(int fd, const std::string& path, int64_t size_bytes, int64_t part_bytes, const std::string& sha256,
                 PartQueue* queue) {
  Sha256Hasher whole;
  for (int64_t begin = 0; begin < size_bytes; begin += part_bytes) {
    const int64_t end = std::min(size_bytes, begin + part_bytes);
    Sha256Hasher hasher;
    for (int64_t at = begin; at < end;) {
      TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadRange(fd, path, at, std::min(kReadBytes, end - at)));
      if (bytes.empty()) return absl::DataLossError(path + " became shorter while it was sent");
      hasher.Update(bytes);
      whole.Update(bytes);
      at += static_cast<int64_t>(bytes.size());
    }
    FilePart part;
    part.number = static_cast<int>(begin / part_bytes) + 1;
    part.body.fd = fd;
    part.body.offset_bytes = begin;
    part.body.size_bytes = end - begin;
    part.sha256 = hasher.Finish();
    if (!queue->Push(std::move(part))) return absl::OkStatus();  // the queue has the error
  }
  if (whole.Finish() != sha256) return absl::DataLossError(path + " does not hash to its SHA-256");
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::string> S3Client::Impl::PutPart(const std::string& key, const std::string& id, int part,
                                              const HttpBody& body, const std::string& sha256) {
  S3Call call;
  call.counter = "put";
  call.method = "PUT";
  call.key = key;
  call.query = {{"partNumber", absl::StrCat(part)}, {"uploadId", id}};
  call.body = body;
  call.sha256 = sha256;
  TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, Send(call));
  const std::optional<std::string> etag = ParseEtag(answer.Header("etag"));
  if (!etag) return absl::InternalError(Name(key) + ": the store's answer to a part has no ETag");
  return *etag;
}

Status S3Client::PutFile(const std::string& key, const std::string& path, int64_t size_bytes,
                         const std::string& sha256) {
  TESSERA_RETURN_IF_ERROR(CheckDigest({sha256, size_bytes}));
  const OpenedFile file(path);
  if (file.fd() < 0) return FileError(errno, "cannot open " + path);
  const S3ClientOptions& options = impl_->options;
  if (size_bytes <= options.max_put_bytes) {
    S3Call call;
    call.counter = "put";
    call.method = "PUT";
    call.key = key;
    call.body = HttpBody{.bytes = {}, .fd = file.fd(), .offset_bytes = 0, .size_bytes = size_bytes};
    call.sha256 = sha256;
    call.headers[kSha256Header] = sha256;
    return impl_->Send(call).status();
  }
  if (size_bytes > kMaxObjectBytes) {
    return InputError(path, "", absl::StrCat(size_bytes, " bytes"), "at most 5 TiB, as S3 allows");
  }
  const int64_t part_bytes = std::max(options.min_part_bytes, (size_bytes + kMaxParts - 1) / kMaxParts);
  const auto parts = static_cast<size_t>((size_bytes + part_bytes - 1) / part_bytes);
  TESSERA_ASSIGN_OR_RETURN(const std::string id, StartUpload(key, sha256));
  const auto at_once = static_cast<size_t>(std::max(1, options.parts_at_once));
  PartQueue queue(parts, at_once);
  std::vector<std::thread> threads;
  for (size_t i = 0; i < std::min(parts, at_once); ++i) {
    threads.emplace_back([&] {
      queue.Work([&](const FilePart& part) { return impl_->PutPart(key, id, part.number, part.body, part.sha256); });
    });
  }
  queue.Close(HashParts(file.fd(), path, size_bytes, part_bytes, sha256, &queue));
  for (std::thread& thread : threads) thread.join();
  const StatusOr<std::vector<std::string>> etags = queue.Etags();
  const Status status = etags.ok() ? CompleteUpload(key, id, *etags) : etags.status();
  if (!status.ok()) AbortUpload(key, id).IgnoreError();  // else its age ends it
  return status;
}

StatusOr<std::string> S3Client::StartUpload(const std::string& key, const std::string& sha256) {
  S3Call call;
  call.counter = "upload";
  call.method = "POST";
  call.key = key;
  call.query = {{"uploads", ""}};
  if (!sha256.empty()) call.headers[kSha256Header] = sha256;
  call.body = HttpBody();
  TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, impl_->Send(call));
  StatusOr<std::string> id = ParseS3UploadId(answer.body);
  if (id.ok()) return id;
  return absl::InternalError(absl::StrCat(impl_->Name(key), ": ", std::string(id.status().message())));
}

Status S3Client::CompleteUpload(const std::string& key, const std::string& id, const std::vector<std::string>& etags) {
  std::string xml = "<CompleteMultipartUpload>";
  for (size_t i = 0; i < etags.size(); ++i) {
    absl::StrAppend(&xml, "<Part><PartNumber>", i + 1, "</PartNumber><ETag>&quot;", EscapeS3Xml(etags[i]),
                    "&quot;</ETag></Part>");
  }
  xml += "</CompleteMultipartUpload>";
  S3Call call;
  call.counter = "upload";
  call.method = "POST";
  call.key = key;
  call.query = {{"uploadId", id}};
  call.headers = {{"content-type", "application/xml"}};
  call.body = HttpBody{.bytes = xml};
  call.sha256 = Sha256Hex(xml);
  call.error_in_body = true;
  const StatusOr<HttpAnswer> answer = impl_->Send(call);
  if (absl::IsNotFound(answer.status())) {
    // The upload does not exist any more. It was completed if a repeated request finds its object.
    const StatusOr<S3Object> object = Head(key);
    if (object.ok() && object->etag == EtagOfParts(etags)) return absl::OkStatus();
  }
  TESSERA_RETURN_IF_ERROR(answer.status());
  const Status completed = CheckS3Completion(answer->body);
  if (completed.ok()) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(impl_->Name(key), ": ", std::string(completed.message())));
}

Status S3Client::AbortUpload(const std::string& key, const std::string& id) {
  S3Call call;
  call.counter = "upload";
  call.method = "DELETE";
  call.key = key;
  call.query = {{"uploadId", id}};
  const Status status = impl_->Send(call).status();
  return absl::IsNotFound(status) ? absl::OkStatus() : status;
}

Status S3Client::Impl::CopyObject(const std::string& from, const std::string& to) {
  S3Call call;
  call.counter = "copy";
  call.method = "PUT";
  call.key = to;
  call.headers["x-amz-copy-source"] = absl::StrCat("/", location.bucket, "/", EncodeUri(FullKey(from), true));
  call.headers["x-amz-metadata-directive"] = "REPLACE";  // without it no object may be copied onto itself
  call.body = HttpBody();
  call.error_in_body = true;
  TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, Send(call));
  const StatusOr<std::string> etag = ParseS3EtagOf("CopyObjectResult", answer.body);
  if (etag.ok()) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(Name(to), ": ", std::string(etag.status().message())));
}

Status S3Client::Copy(const std::string& from, const std::string& to) {
  TESSERA_RETURN_IF_ERROR(CheckS3Key(impl_->FullKey(from)));
  const Status status = impl_->CopyObject(from, to);
  if (!absl::IsInvalidArgument(status)) return status;
  const StatusOr<S3Object> object = Head(from);  // perhaps too large for one call
  if (!object.ok() || object->size_bytes <= kMaxCopyBytes) return status;
  TESSERA_ASSIGN_OR_RETURN(const std::string id, StartUpload(to));
  std::vector<std::string> etags;
  const int64_t part_bytes = std::max(kCopyPartBytes, (object->size_bytes + kMaxParts - 1) / kMaxParts);
  Status copied;
  for (int64_t begin = 0; begin < object->size_bytes && copied.ok(); begin += part_bytes) {
    S3Call call;
    call.counter = "copy";
    call.method = "PUT";
    call.key = to;
    call.query = {{"partNumber", absl::StrCat(etags.size() + 1)}, {"uploadId", id}};
    call.headers["x-amz-copy-source"] =
        absl::StrCat("/", impl_->location.bucket, "/", EncodeUri(impl_->FullKey(from), true));
    call.headers["x-amz-copy-source-if-match"] = absl::StrCat("\"", object->etag, "\"");
    call.headers["x-amz-copy-source-range"] =
        absl::StrCat("bytes=", begin, "-", std::min(object->size_bytes, begin + part_bytes) - 1);
    call.body = HttpBody();
    call.error_in_body = true;
    const StatusOr<HttpAnswer> answer = impl_->Send(call);
    copied = answer.status();
    if (!copied.ok()) break;
    StatusOr<std::string> etag = ParseS3EtagOf("CopyPartResult", answer->body);
    if (etag.ok()) {
      etags.push_back(*std::move(etag));
    } else {
      copied = absl::InternalError(absl::StrCat(impl_->Name(to), ": ", std::string(etag.status().message())));
    }
  }
  if (copied.ok()) copied = CompleteUpload(to, id, etags);
  if (!copied.ok()) AbortUpload(to, id).IgnoreError();
  return copied;
}

Status S3Client::Renew(const std::string& key) { return Copy(key, key); }

}  // namespace tessera

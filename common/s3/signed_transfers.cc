#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/base/random.h"
#include "common/s3/http_client.h"
#include "common/s3/object_stream.h"
#include "common/s3/s3_answers.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_errors.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr char kContentLength[] = "content-length";

}  // namespace

struct SignedTransfers::Impl {
  explicit Impl(const S3ClientOptions& how)
      : options(how), http({.ca_file = how.ca_file, .connect_s = how.connect_s, .silence_s = how.silence_s}) {}

  // The URL without its query, which is secret.
  static std::string Name(const SignedRequest& request) {
    return Printable(Prefix(request.url.substr(0, request.url.find('?')), 500));
  }

  RetryPolicy Policy() {
    RetryPolicy policy = options.retry;
    policy.seed = MixBits(policy.seed ^ MixBits(++calls));
    return policy;
  }

  // One attempt. OK for status 2xx, and 412 and 416 if `accept_range_errors`.
  StatusOr<HttpAnswer> Attempt(const SignedRequest& request, HttpRequest http_request, bool accept_range_errors) {
    http_request.method = request.method;
    http_request.url = request.url;
    http_request.headers.insert(request.headers.begin(), request.headers.end());
    http_request.headers.erase(kContentLength);  // libcurl sends it
    TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, http.Send(http_request));
    const bool accepted = accept_range_errors && (answer.status == 412 || answer.status == 416);
    if (answer.status / 100 == 2 || accepted) return answer;
    const std::string query = request.url.substr(std::min(request.url.size(), request.url.find('?')));
    return S3ErrorOf(answer, {Name(request), 0, SecretsOf(query), true});
  }

  // Values of the query, which a store may repeat in its messages.
  static std::vector<std::string> SecretsOf(const std::string& query) {
    std::vector<std::string> secrets;
    for (const char* name : {"X-Amz-Signature=", "X-Amz-Security-Token=", "X-Amz-Credential="}) {
      const size_t at = query.find(name);
      if (at == std::string::npos) continue;
      const size_t begin = query.find('=', at) + 1;
      secrets.push_back(query.substr(begin, query.find('&', begin) - begin));
    }
    return secrets;
  }

  const S3ClientOptions options;
  const HttpClient http;
  std::atomic<uint64_t> calls{0};
};

SignedTransfers::SignedTransfers(const S3ClientOptions& options) : impl_(new Impl(options)) {}
SignedTransfers::~SignedTransfers() = default;

Status SignedTransfers::Get(const SignedRequest& request, int64_t offset_bytes,
                            const std::function<Status(std::string_view bytes)>& take) {
  const SendGet send = [&](const HttpHeaders& headers, const auto& take_part) {
    HttpRequest http_request;
    http_request.headers = headers;
    http_request.take = take_part;
    return impl_->Attempt(request, std::move(http_request), true);
  };
  return StreamObject(Impl::Name(request), send, offset_bytes, impl_->Policy(), impl_->options.sleeper, take);
}

StatusOr<std::string> SignedTransfers::Put(const SignedRequest& request, const std::string& path, int64_t offset_bytes,
                                           int64_t size_bytes,
                                           const std::function<Status(int64_t sent_bytes)>& progress) {
  const auto signed_size = request.headers.find(kContentLength);
  if (signed_size != request.headers.end() && signed_size->second != absl::StrCat(size_bytes)) {
    return absl::DataLossError(absl::StrCat(path, ": found ", size_bytes, " bytes to send, expected ",
                                            Printable(signed_size->second), " as its URL was signed for"));
  }
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return FileError(errno, "cannot open " + path);
  std::optional<std::string> etag;
  Status status = Retry(impl_->Policy(), Idempotency::kOnce, impl_->options.sleeper, [&]() -> Status {
    HttpRequest http_request;
    http_request.body =
        HttpBody{.bytes = {}, .fd = fd, .offset_bytes = offset_bytes, .size_bytes = size_bytes, .progress = progress};
    TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, impl_->Attempt(request, std::move(http_request), false));
    etag = ParseEtag(answer.Header("etag"));
    return absl::OkStatus();
  });
  ::close(fd);
  TESSERA_RETURN_IF_ERROR(status);
  if (!etag) return absl::InternalError(Impl::Name(request) + ": the store's answer has no ETag");
  return *etag;
}

}  // namespace tessera

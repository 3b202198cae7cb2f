#include "common/s3/http_client.h"

#include <curl/curl.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "common/base/printable.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr size_t kMaxIdleHandles = 32;
constexpr size_t kMaxHeaders = 100;
constexpr size_t kMaxErrorBytes = 64 << 10;
constexpr long kBufferBytes = 512 << 10;
constexpr long kSilentBytesPerSecond = 100;

struct FreeHandle {
  void operator()(CURL* handle) const { curl_easy_cleanup(handle); }
};
using Handle = std::unique_ptr<CURL, FreeHandle>;

struct FreeHeaders {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};

// One request under way.
struct Exchange {
  const HttpRequest* request = nullptr;
  HttpAnswer answer;
  Status status;         // why a callback ended the transfer
  bool cut = false;      // the body of an error was long enough
  int64_t position = 0;  // in the request's body
  int64_t received_bytes = 0;
};

size_t TakeHeader(char* data, size_t, size_t size, void* user) {
  Exchange& exchange = *static_cast<Exchange*>(user);
  const std::string_view line(data, size);
  if (line.starts_with("HTTP/")) {  // also after "100 Continue"
    exchange.answer.headers.clear();
    return size;
  }
  const size_t colon = line.find(':');
  if (colon == std::string_view::npos || exchange.answer.headers.size() >= kMaxHeaders) return size;
  const auto text = [](std::string_view part) { return absl::string_view(part.data(), part.size()); };
  exchange.answer.headers[absl::AsciiStrToLower(text(line.substr(0, colon)))] =
      std::string(absl::StripAsciiWhitespace(text(line.substr(colon + 1))));
  return size;
}

// Returns less than `size` to end the transfer.
size_t TakeBody(CURL* handle, Exchange& exchange, std::string_view bytes) {
  long status = 0;
  curl_easy_getinfo(handle, CURLINFO_RESPONSE_CODE, &status);
  exchange.answer.status = static_cast<int>(status);
  exchange.received_bytes += static_cast<int64_t>(bytes.size());
  std::string& body = exchange.answer.body;
  if (status / 100 != 2) {
    body.append(bytes.substr(0, kMaxErrorBytes - std::min(body.size(), kMaxErrorBytes)));
    exchange.cut = body.size() >= kMaxErrorBytes;
    return exchange.cut ? 0 : bytes.size();
  }
  if (exchange.request->take) {
    exchange.status = exchange.request->take(exchange.answer, bytes);
  } else if (static_cast<int64_t>(body.size() + bytes.size()) > exchange.request->max_answer_bytes) {
    exchange.status = absl::InternalError(
        absl::StrCat("the answer is longer than the ", exchange.request->max_answer_bytes, " bytes that are allowed"));
  } else {
    body.append(bytes);
  }
  return exchange.status.ok() ? bytes.size() : 0;
}

struct HandleAndExchange {
  CURL* handle;
  Exchange* exchange;
};

size_t WriteCallback(char* data, size_t, size_t size, void* user) {
  const HandleAndExchange& both = *static_cast<HandleAndExchange*>(user);
  return TakeBody(both.handle, *both.exchange, {data, size});
}

size_t ReadCallback(char* to, size_t unit, size_t count, void* user) {
  Exchange& exchange = *static_cast<Exchange*>(user);
  const HttpBody& body = *exchange.request->body;
  size_t size = unit * count;
  if (body.fd < 0) {
    size = body.bytes.copy(to, size, static_cast<size_t>(exchange.position));
  } else {
    size = std::min(size, static_cast<size_t>(body.size_bytes - exchange.position));
    const ssize_t got = size == 0 ? 0 : ::pread(body.fd, to, size, body.offset_bytes + exchange.position);
    if (got < 0) exchange.status = FileError(errno, "cannot read the file to send");
    if (got == 0 && size > 0) exchange.status = absl::DataLossError("the file became shorter while it was sent");
    if (exchange.status.ok() && body.progress) exchange.status = body.progress(exchange.position);
    if (!exchange.status.ok()) return CURL_READFUNC_ABORT;
    size = static_cast<size_t>(got);
  }
  exchange.position += static_cast<int64_t>(size);
  return size;
}

// libcurl sends the body again if a kept connection turns out to be closed.
int SeekCallback(void* user, curl_off_t offset, int origin) {
  if (origin != SEEK_SET) return CURL_SEEKFUNC_CANTSEEK;
  static_cast<Exchange*>(user)->position = offset;
  return CURL_SEEKFUNC_OK;
}

// Child processes do not inherit the connection.
int SocketCallback(void*, curl_socket_t socket, curlsocktype) {
  ::fcntl(socket, F_SETFD, FD_CLOEXEC);
  return CURL_SOCKOPT_OK;
}

std::string HostOf(const std::string& url) {
  const size_t begin = url.find("://");
  if (begin == std::string::npos) return "a URL without http:// or https://";
  return Printable(url.substr(begin + 3, url.find_first_of("/?#", begin + 3) - begin - 3));
}

Status CurlError(CURLcode code, const std::string& url, const char* details, double silence_s) {
  const std::string message = absl::StrCat(HostOf(url), ": ", *details ? details : curl_easy_strerror(code));
  switch (code) {
    case CURLE_OPERATION_TIMEDOUT:
      return absl::UnavailableError(
          absl::StrCat(HostOf(url), ": no connection in time, or no bytes for ", silence_s, " s"));
    case CURLE_PEER_FAILED_VERIFICATION:
    case CURLE_SSL_CACERT_BADFILE:
    case CURLE_SSL_ISSUER_ERROR:
      return absl::FailedPreconditionError(absl::StrCat(message, ": the server's certificate is not trusted"));
    case CURLE_URL_MALFORMAT:
      return absl::InvalidArgumentError(absl::StrCat(HostOf(url), ": not a valid http or https URL"));
    case CURLE_FILESIZE_EXCEEDED:
      return absl::InternalError(message);
    default:
      return absl::UnavailableError(message);
  }
}

bool HasControls(const std::string& text) {
  return std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 127; });
}

}  // namespace

const std::string& HttpAnswer::Header(const std::string& name) const {
  static const std::string kNone;
  const auto found = headers.find(name);
  return found == headers.end() ? kNone : found->second;
}

std::optional<int64_t> HttpAnswer::Number(const std::string& name) const {
  int64_t value = 0;
  if (!absl::SimpleAtoi(Header(name), &value) || value < 0) return std::nullopt;
  return value;
}

std::optional<int64_t> HttpAnswer::Time(const std::string& name) const {
  const time_t time = curl_getdate(Header(name).c_str(), nullptr);
  if (Header(name).empty() || time < 0) return std::nullopt;
  return int64_t{time} * 1'000'000;
}

struct HttpClient::Impl {
  HttpClientOptions options;
  std::mutex mutex;
  std::vector<Handle> idle;

  Handle Take() {
    const std::lock_guard lock(mutex);
    if (idle.empty()) return Handle(curl_easy_init());
    Handle handle = std::move(idle.back());
    idle.pop_back();
    return handle;
  }
  void GiveBack(Handle handle) {
    curl_easy_reset(handle.get());  // keeps its connections
    const std::lock_guard lock(mutex);
    if (idle.size() < kMaxIdleHandles) idle.push_back(std::move(handle));
  }
};

HttpClient::HttpClient(const HttpClientOptions& options) : impl_(new Impl) {
  static const CURLcode started = curl_global_init(CURL_GLOBAL_DEFAULT);
  static_cast<void>(started);
  impl_->options = options;
}

HttpClient::~HttpClient() = default;

StatusOr<HttpAnswer> HttpClient::Send(const HttpRequest& request, HttpTraffic* traffic) const {
  const HttpClientOptions& options = impl_->options;
  if (!request.url.starts_with("http://") && !request.url.starts_with("https://")) {
    return absl::InvalidArgumentError("found a URL of another scheme, expected http:// or https://");
  }
  Handle owned = impl_->Take();
  CURL* const handle = owned.get();
  if (handle == nullptr) return absl::UnavailableError("libcurl has no memory for a request");
  Exchange exchange;
  exchange.request = &request;
  HandleAndExchange both{handle, &exchange};
  char details[CURL_ERROR_SIZE] = "";
  curl_slist* list = nullptr;
  for (const auto& [name, value] : request.headers) {
    if (HasControls(name) || HasControls(value)) {
      curl_slist_free_all(list);
      return absl::InvalidArgumentError(absl::StrCat(HostOf(request.url), ": a header with control characters"));
    }
    list = curl_slist_append(list, value.empty() ? (name + ";").c_str() : absl::StrCat(name, ": ", value).c_str());
  }
  const std::unique_ptr<curl_slist, FreeHeaders> headers(list);

  curl_easy_setopt(handle, CURLOPT_URL, request.url.c_str());
  curl_easy_setopt(handle, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(handle, CURLOPT_DISALLOW_USERNAME_IN_URL, 1L);
  curl_easy_setopt(handle, CURLOPT_PATH_AS_IS, 1L);
  curl_easy_setopt(handle, CURLOPT_HTTP_VERSION, CURL_HTTP_VERSION_1_1);
  curl_easy_setopt(handle, CURLOPT_SSLVERSION, CURL_SSLVERSION_TLSv1_2);
  curl_easy_setopt(handle, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(handle, CURLOPT_ERRORBUFFER, details);
  curl_easy_setopt(handle, CURLOPT_HTTPHEADER, headers.get());
  curl_easy_setopt(handle, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  curl_easy_setopt(handle, CURLOPT_BUFFERSIZE, kBufferBytes);
  curl_easy_setopt(handle, CURLOPT_UPLOAD_BUFFERSIZE, kBufferBytes);
  curl_easy_setopt(handle, CURLOPT_SOCKOPTFUNCTION, SocketCallback);
  curl_easy_setopt(handle, CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(options.connect_s * 1000));
  curl_easy_setopt(handle, CURLOPT_LOW_SPEED_LIMIT, kSilentBytesPerSecond);
  curl_easy_setopt(handle, CURLOPT_LOW_SPEED_TIME, std::max(1L, std::lround(options.silence_s)));
  if (!options.ca_file.empty()) curl_easy_setopt(handle, CURLOPT_CAINFO, options.ca_file.c_str());
  if (!options.use_proxy) curl_easy_setopt(handle, CURLOPT_NOPROXY, "*");
  curl_easy_setopt(handle, CURLOPT_HEADERFUNCTION, TakeHeader);
  curl_easy_setopt(handle, CURLOPT_HEADERDATA, &exchange);
  curl_easy_setopt(handle, CURLOPT_WRITEFUNCTION, WriteCallback);
  curl_easy_setopt(handle, CURLOPT_WRITEDATA, &both);
  if (request.method == "HEAD") curl_easy_setopt(handle, CURLOPT_NOBODY, 1L);
  if (request.body) {
    const int64_t size =
        request.body->fd < 0 ? static_cast<int64_t>(request.body->bytes.size()) : request.body->size_bytes;
    curl_easy_setopt(handle, CURLOPT_UPLOAD, 1L);
    curl_easy_setopt(handle, CURLOPT_INFILESIZE_LARGE, static_cast<curl_off_t>(size));
    curl_easy_setopt(handle, CURLOPT_READFUNCTION, ReadCallback);
    curl_easy_setopt(handle, CURLOPT_READDATA, &exchange);
    curl_easy_setopt(handle, CURLOPT_SEEKFUNCTION, SeekCallback);
    curl_easy_setopt(handle, CURLOPT_SEEKDATA, &exchange);
  }
  const CURLcode code = curl_easy_perform(handle);
  long status = 0;
  curl_easy_getinfo(handle, CURLINFO_RESPONSE_CODE, &status);
  exchange.answer.status = static_cast<int>(status);
  if (traffic != nullptr) *traffic = {exchange.position, exchange.received_bytes};
  impl_->GiveBack(std::move(owned));
  if (!exchange.status.ok()) return exchange.status;
  if (code != CURLE_OK && !exchange.cut) return CurlError(code, request.url, details, options.silence_s);
  return std::move(exchange.answer);
}

}  // namespace tessera

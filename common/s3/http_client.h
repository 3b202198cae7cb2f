// HTTP requests over libcurl. Connections are kept and used again.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace tessera {

// Names in lower case.
using HttpHeaders = std::map<std::string, std::string>;

struct HttpAnswer {
  int status = 0;
  HttpHeaders headers;  // empty values included; of repeated ones the last
  std::string body;

  // Empty if the answer has no such header. `name`: lower case.
  const std::string& Header(const std::string& name) const;
  // The header as a number of at least 0.
  std::optional<int64_t> Number(const std::string& name) const;
  // The header as a Unix time in microseconds, from the form "Fri, 24 May 2013 00:00:00 GMT".
  std::optional<int64_t> Time(const std::string& name) const;
};

// Content of a request: bytes, or a part of an open file (fd >= 0).
struct HttpBody {
  std::string_view bytes;
  int fd = -1;
  int64_t offset_bytes = 0, size_bytes = 0;  // of the file
  // Called while the file is sent, with the bytes sent so far. An error ends the transfer and is returned.
  std::function<Status(int64_t sent_bytes)> progress = {};
};

struct HttpRequest {
  std::string method = "GET";
  std::string url;  // http or https
  HttpHeaders headers;
  std::optional<HttpBody> body;
  // A longer body of a 2xx answer is an error. Of other answers, the first 64 KiB are kept.
  int64_t max_answer_bytes = int64_t{16} << 20;
  // Receives the body of a 2xx answer in parts, in place of HttpAnswer::body and max_answer_bytes. `head`: status and
  // headers. An error ends the transfer and is returned.
  std::function<Status(const HttpAnswer& head, std::string_view bytes)> take;
};

struct HttpTraffic {
  int64_t sent_bytes = 0, received_bytes = 0;  // of bodies
};

struct HttpClientOptions {
  std::string ca_file;    // PEM; empty: the system's authorities
  double connect_s = 10;  // limit of a connection's setup
  double silence_s = 30;  // a request that moves less than 100 bytes a second for this time is ended
  bool use_proxy = true;  // that the environment names (https_proxy, no_proxy)
};

// Thread-safe. Does not follow redirects and does not repeat requests.
class HttpClient {
 public:
  explicit HttpClient(const HttpClientOptions& options);
  ~HttpClient();

  // Any answer is OK, whatever its status. UNAVAILABLE: no connection, a lost one, or silence. FAILED_PRECONDITION: the
  // server's certificate is not trusted. INTERNAL: the answer is longer than allowed. INVALID_ARGUMENT: a wrong URL or
  // header. DATA_LOSS: the file of the body is shorter than declared. Messages name the host, never the path, query or
  // headers.
  StatusOr<HttpAnswer> Send(const HttpRequest& request, HttpTraffic* traffic = nullptr) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

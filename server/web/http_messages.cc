#include "server/web/http_messages.h"

#include <httplib.h>
#undef _res  // a macro of <resolv.h>, and a name in Eigen

#include <algorithm>
#include <cstring>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr size_t kMaxRequestsOfConnection = 1'000'000;

std::string_view ReasonOf(int status) {
  switch (status) {
    case 400:
      return "Bad Request";
    case 413:
      return "Content Too Large";
    case 414:
      return "URI Too Long";
    case 431:
      return "Request Header Fields Too Large";
    case 501:
      return "Not Implemented";
    case 503:
      return "Service Unavailable";
    case 505:
      return "HTTP Version Not Supported";
    default:
      return "Error";
  }
}

// One request and its answer. httplib reads the head from here; the body is already separate.
class Exchange final : public httplib::Stream {
 public:
  Exchange(ReceivedRequest request, AnswerOutput& output, const HttpMessages::Answerer& answerer)
      : request_(std::move(request)), output_(output), answerer_(answerer) {}

  bool is_readable() const override { return read_ < request_.frame.head.size(); }
  bool is_writable() const override { return !broken_; }
  ssize_t read(char* to, size_t size) override {
    const size_t n = std::min(size, request_.frame.head.size() - read_);
    std::memcpy(to, request_.frame.head.data() + read_, n);
    read_ += n;
    return static_cast<ssize_t>(n);
  }
  ssize_t write(const char* bytes, size_t size) override {
    if (broken_ || !output_.Write({bytes, size})) {
      broken_ = true;
      return -1;
    }
    return static_cast<ssize_t>(size);
  }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  socket_t socket() const override { return 0; }  // httplib compares it with a limit only

  bool broken() const { return broken_; }
  bool skipped() const { return skipped_; }

  void Answer(const httplib::Request& parsed, httplib::Response& response) {
    WebRequest request;
    request.method = parsed.method;
    request.target = request_.frame.target;
    request.headers.assign(parsed.headers.begin(), parsed.headers.end());
    const auto add = [&](const char* name, const std::string& value) {
      if (!value.empty()) request.headers.emplace_back(name, value);
    };
    add("Range", request_.frame.range);
    add("Accept-Encoding", request_.frame.accept_encoding);
    request.params.assign(parsed.params.begin(), parsed.params.end());
    request.body = std::move(request_.body);
    request.peer = request_.peer;
    request.tls = request_.tls;
    request.arrived = request_.arrived;
    std::optional<WebAnswer> answer = answerer_(request);
    if (answer) return Fill(*std::move(answer), response);
    skipped_ = true;
    broken_ = true;  // what httplib writes is dropped
  }

 private:
  void Fill(WebAnswer answer, httplib::Response& response) {
    response.status = answer.status;
    for (const auto& [name, value] : answer.headers) response.set_header(name, value);
    if (!answer.produce) {
      if (!answer.type.empty()) {
        response.set_content(answer.body, answer.type);
      } else {
        response.body = std::move(answer.body);
      }
      return;
    }
    const auto sink_of = [this](httplib::DataSink& sink) {
      return AnswerSink{[this, &sink](std::string_view bytes) {
                          sink.write(bytes.data(), bytes.size());
                          return !broken_;
                        },
                        [this] { return !broken_ && output_.Connected(); }};
    };
    if (answer.produced_bytes && *answer.produced_bytes > 0) {
      response.set_content_provider(static_cast<size_t>(*answer.produced_bytes), answer.type,
                                    [produce = std::move(answer.produce), sink_of](
                                        size_t, size_t, httplib::DataSink& sink) { return produce(sink_of(sink)); });
    } else if (answer.produced_bytes) {
      response.set_content("", answer.type);
    } else {
      response.set_chunked_content_provider(
          answer.type, [produce = std::move(answer.produce), sink_of](size_t, httplib::DataSink& sink) {
            const bool whole = produce(sink_of(sink));
            if (whole) sink.done();
            return whole;
          });
    }
  }

  ReceivedRequest request_;
  AnswerOutput& output_;
  const HttpMessages::Answerer& answerer_;
  size_t read_ = 0;
  bool broken_ = false, skipped_ = false;
};

// The exchange of this thread: httplib's handlers know only the request.
thread_local Exchange* current_exchange = nullptr;

// httplib without its connections and threads.
class Parser final : public httplib::Server {
 public:
  explicit Parser(double keep_s) {
    svr_sock_ = 0;  // else httplib takes the server for stopped, and ends answers that are written in parts
    set_keep_alive_timeout(static_cast<time_t>(keep_s));
    set_keep_alive_max_count(kMaxRequestsOfConnection);
    set_pre_routing_handler([](const httplib::Request& request, httplib::Response& response) {
      current_exchange->Answer(request, response);
      return HandlerResponse::Handled;
    });
    set_exception_handler([](const httplib::Request&, httplib::Response& response, std::exception_ptr) {
      response.status = 500;
      response.headers.clear();
      response.body.clear();
    });
  }
  bool Serve(Exchange& exchange) {
    current_exchange = &exchange;
    bool closes = false;
    const bool good = process_request(exchange, false, closes, nullptr);
    current_exchange = nullptr;
    return good && !closes && !exchange.broken();
  }
};

}  // namespace

struct HttpMessages::Impl {
  explicit Impl(double keep_s) : parser(keep_s) {}
  Parser parser;
};

HttpMessages::HttpMessages(double keep_s) : impl_(std::make_unique<Impl>(keep_s)) {}
HttpMessages::~HttpMessages() = default;

std::optional<bool> HttpMessages::Serve(ReceivedRequest request, AnswerOutput& output, const Answerer& answerer) {
  Exchange exchange(std::move(request), output, answerer);
  const bool goes_on = impl_->parser.Serve(exchange);
  return exchange.skipped() ? std::nullopt : std::optional(goes_on);
}

std::string PlainAnswer(const WebAnswer& answer) {
  std::string text = absl::StrCat("HTTP/1.1 ", answer.status, " ", std::string(ReasonOf(answer.status)),
                                  "\r\nConnection: close\r\nContent-Length: ", answer.body.size(), "\r\n");
  if (!answer.type.empty()) absl::StrAppend(&text, "Content-Type: ", answer.type, "\r\n");
  for (const auto& [name, value] : answer.headers) absl::StrAppend(&text, name, ": ", value, "\r\n");
  return absl::StrCat(text, "\r\n", answer.body);
}

}  // namespace tessera

#include "server/http/http_server.h"

#include <optional>
#include <utility>

#include "server/grpc/local_calls.h"
#include "server/http/site.h"
#include "server/web/http_messages.h"
#include "server/web/tls_context.h"

namespace tessera {
namespace {

class SiteHandler final : public RequestHandler {
 public:
  SiteHandler(const SiteEnvironment& environment, double keep_s) : site_(environment), messages_(keep_s) {}
  Lane LaneOf(const RequestFrame& request) override { return Site::LaneOf(request); }
  std::string OwnerOf(Lane lane, const ReceivedRequest& request) override { return site_.OwnerOf(lane, request); }
  std::optional<bool> ServeAtOnce(const ReceivedRequest& request, AnswerOutput& output) override {
    if (!Site::MayAnswerAtOnce(request.frame)) return std::nullopt;
    return messages_.Serve(request, output, [this](const WebRequest& parsed) { return site_.AnswerAtOnce(parsed); });
  }
  bool Serve(ReceivedRequest request, AnswerOutput& output) override {
    return messages_
        .Serve(std::move(request), output, [this](const WebRequest& parsed) { return site_.Answer(parsed); })
        .value_or(false);
  }
  std::string Refusal(int status) override { return PlainAnswer(site_.Refusal(status)); }

 private:
  Site site_;
  HttpMessages messages_;
};

}  // namespace

struct HttpServer::Impl {
  LocalCalls* calls = nullptr;
  std::unique_ptr<TlsContext> tls;  // null: none
  std::unique_ptr<SiteHandler> handler;
  std::unique_ptr<Connections> connections;
};

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() {
  impl_->calls->Stop();
  impl_->connections.reset();
}

StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(const HttpOptions& options, CoordinatorServer* server) {
  auto impl = std::make_unique<Impl>();
  if (server->certificates() != nullptr) {
    TESSERA_ASSIGN_OR_RETURN(impl->tls, TlsContext::Make(server->certificates()));
  }
  impl->calls = &server->local_calls();
  SiteEnvironment environment;
  environment.calls = impl->calls;
  environment.watches = &server->watches();
  environment.access = &server->access();
  environment.version = options.version;
  environment.tls = impl->tls != nullptr;
  environment.insecure = options.insecure;
  environment.before_reply = options.before_reply;
  environment.counts = options.counts;
  impl->handler = std::make_unique<SiteHandler>(environment, options.limits.idle_s);
  TESSERA_ASSIGN_OR_RETURN(impl->connections,
                           Connections::Listen(options.address, impl->tls.get(), impl->handler.get(), options.limits));
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

const std::string& HttpServer::address() const { return impl_->connections->address(); }

std::string HttpServer::url() const { return (impl_->tls == nullptr ? "http://" : "https://") + address() + "/"; }

int HttpServer::threads() const { return impl_->connections->threads(); }

}  // namespace tessera

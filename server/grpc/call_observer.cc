#include "server/grpc/call_observer.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message_lite.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/support/server_interceptor.h>

#include <chrono>
#include <optional>
#include <string_view>
#include <utility>

#include "server/auth/audit.h"
#include "tessera/v1/blobs.pb.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {
namespace {

using google::protobuf::MessageLite;
using grpc::experimental::InterceptionHookPoints;
using Steady = std::chrono::steady_clock;

// Observes one call. gRPC calls it once per event, in order.
class CallObserver final : public grpc::experimental::Interceptor {
 public:
  CallObserver(RpcCounts& counts, const Access& access, const std::function<void()>& before_reply,
               grpc::experimental::ServerRpcInfo& info)
      : counts_(counts),
        access_(access),
        before_reply_(before_reply),
        info_(info),
        method_(info.method()),
        counted_(counts.Of(method_)),
        audited_(IsAudited(method_)),
        reads_blob_(method_ == "/tessera.v1.Blobs/ReadBlob"),
        writes_blob_(method_ == "/tessera.v1.Blobs/WriteBlob") {}

  void Intercept(grpc::experimental::InterceptorBatchMethods* event) override {
    if (event->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE) && (audited_ || writes_blob_)) {
      Received(static_cast<const MessageLite*>(event->GetRecvMessage()));
    }
    if (event->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_MESSAGE) && (audited_ || reads_blob_)) {
      Sent(static_cast<const MessageLite*>(event->GetSendMessage()));
    }
    if (event->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) Ended(event->GetSendStatus());
    if (before_reply_ && (event->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_MESSAGE) ||
                          event->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS))) {
      before_reply_();
    }
    event->Proceed();
  }

 private:
  // Null if there is no message or it could not be parsed.
  void Received(const MessageLite* message) {
    if (message == nullptr) return;
    if (audited_ && !asked_) {
      asked_ = AuditedRequest(method_, *message);
      if (!asked_) audited_ = false;  // a query changes nothing
    }
    if (!writes_blob_) return;
    if (const auto* write = dynamic_cast<const v1::WriteBlobRequest*>(message)) {
      counts_.CountBlobBytes(0, static_cast<int64_t>(write->chunk().data().size()));
    }
  }

  void Sent(const MessageLite* message) {
    if (message == nullptr) return;
    if (audited_) made_ = AuditedResponse(method_, *message);
    if (!reads_blob_) return;
    if (const auto* chunk = dynamic_cast<const v1::BlobChunk*>(message)) {
      counts_.CountBlobBytes(static_cast<int64_t>(chunk->data().size()), 0);
    }
  }

  void Ended(const grpc::Status& status) {
    RpcCounts::Count(counted_, status.error_code(), std::chrono::duration<double>(Steady::now() - begun_).count());
    if (!audited_) return;
    LogFields what = asked_.value_or(LogFields());
    if (status.ok()) what.insert(what.begin(), made_.begin(), made_.end());
    const grpc::ServerContextBase& context = *info_.server_context();
    LogAudit(method_, access_.PeerOf(context), access_.CallerOf(context).name, RpcCounts::CodeName(status.error_code()),
             status.error_message(), what);
  }

  RpcCounts& counts_;
  const Access& access_;
  const std::function<void()>& before_reply_;
  grpc::experimental::ServerRpcInfo& info_;
  const std::string_view method_;
  RpcCounts::OfMethod& counted_;
  bool audited_;
  const bool reads_blob_, writes_blob_;
  const Steady::time_point begun_ = Steady::now();
  std::optional<LogFields> asked_;
  LogFields made_;
};

class CallObservers final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  CallObservers(RpcCounts* counts, const Access* access, std::function<void()> before_reply)
      : counts_(*counts), access_(*access), before_reply_(std::move(before_reply)) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(grpc::experimental::ServerRpcInfo* info) override {
    return new CallObserver(counts_, access_, before_reply_, *info);
  }

 private:
  RpcCounts& counts_;
  const Access& access_;
  const std::function<void()> before_reply_;
};

}  // namespace

std::vector<std::string> AllMethods() {
  std::vector<std::string> methods;
  for (const auto* file : {v1::CreateJobRequest::descriptor()->file(), v1::RegisterWorkerRequest::descriptor()->file(),
                           v1::BlobChunk::descriptor()->file()}) {
    for (int i = 0; i < file->service_count(); ++i) {
      const auto& service = *file->service(i);
      for (int k = 0; k < service.method_count(); ++k) {
        methods.push_back("/" + service.full_name() + "/" + service.method(k)->name());
      }
    }
  }
  return methods;
}

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> ObserveCalls(
    RpcCounts* counts, const Access* access, std::function<void()> before_reply) {
  return std::make_unique<CallObservers>(counts, access, std::move(before_reply));
}

}  // namespace tessera

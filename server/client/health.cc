#include "server/client/health.h"

#include <google/protobuf/empty.pb.h>
#include <google/protobuf/unknown_field_set.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <memory>

#include "absl/strings/str_cat.h"
#include "common/rpc/status_conversion.h"

namespace tessera {
namespace {

// Of health.proto, which libgrpc++ implements but does not ship. The request names a service; without one it is about
// the whole server, and empty. The response has one field.
constexpr char kCheckMethod[] = "/grpc.health.v1.Health/Check";
constexpr int kStatusField = 1;
constexpr uint64_t kServing = 1;

}  // namespace

Status CheckHealth(const Endpoint& endpoint, double timeout_s) {
  TESSERA_ASSIGN_OR_RETURN(const auto channel,
                           OpenChannel(endpoint, std::make_shared<CallIdentity>(endpoint.token_file)));
  grpc::ClientContext context;
  SetDeadline(context, timeout_s);
  TESSERA_RETURN_IF_ERROR(WaitConnected(*channel, endpoint.address, timeout_s));
  grpc::CompletionQueue queue;
  const auto call =
      grpc::TemplatedGenericStub<google::protobuf::Empty, google::protobuf::Empty>(channel).PrepareUnaryCall(
          &context, kCheckMethod, google::protobuf::Empty(), &queue);
  call->StartCall();
  google::protobuf::Empty response;
  grpc::Status status;
  call->Finish(&response, &status, &queue);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  TESSERA_RETURN_IF_ERROR(FromGrpc(status));
  const google::protobuf::UnknownFieldSet& fields =
      google::protobuf::Empty::GetReflection()->GetUnknownFields(response);
  for (int i = 0; i < fields.field_count(); ++i) {
    const google::protobuf::UnknownField& field = fields.field(i);
    if (field.number() == kStatusField && field.type() == google::protobuf::UnknownField::TYPE_VARINT &&
        field.varint() == kServing) {
      return absl::OkStatus();
    }
  }
  return absl::UnavailableError(
      absl::StrCat("the coordinator at ", endpoint.address,
                   " does not serve: it is stopping, or cannot store its state; see its log"));
}

}  // namespace tessera

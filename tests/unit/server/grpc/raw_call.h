// Calls a method by name with serialized messages, for requests that generated stubs cannot send.
#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/rpc/channel.h"

namespace tessera {

using CallMetadata = std::vector<std::pair<std::string, std::string>>;

// Sends one message. Appends the bytes of an answer, if any, to *answer, which may be null.
inline grpc::Status RawCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                            const std::string& request, const CallMetadata& metadata, std::string* answer) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  SetDeadline(context, 20);
  for (const auto& [key, value] : metadata) context.AddMetadata(key, value);
  grpc::CompletionQueue queue;
  const grpc::Slice slice(request);
  const grpc::ByteBuffer sent(&slice, 1);
  const auto call = stub.PrepareUnaryCall(&context, method, sent, &queue);
  call->StartCall();
  grpc::ByteBuffer received;
  grpc::Status status;
  call->Finish(&received, &status, &queue);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  std::vector<grpc::Slice> slices;
  if (answer != nullptr && status.ok() && received.Dump(&slices).ok()) {
    for (const grpc::Slice& each : slices) answer->append(reinterpret_cast<const char*>(each.begin()), each.size());
  }
  return status;
}

}  // namespace tessera

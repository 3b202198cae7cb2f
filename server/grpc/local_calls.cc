#include "server/grpc/local_calls.h"

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"

namespace tessera {
namespace {

std::string TextOf(const grpc::ByteBuffer& buffer) {
  std::string bytes;
  std::vector<grpc::Slice> slices;
  if (!buffer.Dump(&slices).ok()) return bytes;
  bytes.reserve(buffer.Length());
  for (const grpc::Slice& slice : slices) bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  return bytes;
}

grpc::ByteBuffer BufferOf(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  return grpc::ByteBuffer(&slice, 1);
}

// Waits for the only operation of the queue.
bool AwaitNext(grpc::CompletionQueue& queue) {
  void* tag = nullptr;
  bool ok = false;
  return queue.Next(&tag, &ok) && ok;
}

void CloseQueue(grpc::CompletionQueue& queue) {
  queue.Shutdown();
  void* tag = nullptr;
  for (bool ok = false; queue.Next(&tag, &ok);) continue;
}

}  // namespace

struct LocalCalls::Impl {
  Impl(std::shared_ptr<grpc::Channel> to, const Access* checks) : channel(std::move(to)), access(checks) {}

  // A running call, which Stop cancels.
  class Running {
   public:
    explicit Running(Impl* calls) : calls_(calls) {
      std::lock_guard lock(calls_->mutex);
      if (calls_->stopped) context.TryCancel();
      calls_->running.insert(&context);
    }
    ~Running() {
      std::lock_guard lock(calls_->mutex);
      calls_->running.erase(&context);
    }
    grpc::ClientContext context;

   private:
    Impl* const calls_;
  };

  void Prepare(grpc::ClientContext& context, const LocalCaller& caller) const {
    if (caller.authorization) context.AddMetadata("authorization", *caller.authorization);
    context.AddMetadata(kForwardedPeerMetadata, access->ForwardedPeer(caller.peer));
  }

  const std::shared_ptr<grpc::Channel> channel;
  const Access* const access;
  grpc::GenericStub stub{channel};
  std::mutex mutex;
  bool stopped = false;
  std::set<grpc::ClientContext*> running;
};

LocalCalls::LocalCalls(std::shared_ptr<grpc::Channel> channel, const Access* access)
    : impl_(std::make_unique<Impl>(std::move(channel), access)) {}
LocalCalls::~LocalCalls() = default;

Status LocalCalls::Admit(const std::string& method, const LocalCaller& caller) const {
  return impl_->access->Admit(method, impl_->access->Identify("", caller.authorization),
                              caller.authorization.has_value(), caller.peer);
}

StatusOr<std::string> LocalCalls::Call(const std::string& method, const LocalCaller& caller, const std::string& request,
                                       double deadline_s) {
  TESSERA_RETURN_IF_ERROR(Admit(method, caller));
  Impl::Running running(impl_.get());
  impl_->Prepare(running.context, caller);
  SetDeadline(running.context, deadline_s);
  grpc::CompletionQueue queue;
  const auto call = impl_->stub.PrepareUnaryCall(&running.context, method, BufferOf(request), &queue);
  call->StartCall();
  grpc::ByteBuffer answer;
  grpc::Status status;
  call->Finish(&answer, &status, nullptr);
  AwaitNext(queue);
  CloseQueue(queue);
  if (!status.ok()) return FromGrpc(status);
  return TextOf(answer);
}

struct LocalCalls::Stream::Impl {
  explicit Impl(LocalCalls::Impl* calls) : running(calls) {}
  ~Impl() {
    running.context.TryCancel();
    if (reading) AwaitNext(queue);
    if (!ended) Finish();
    CloseQueue(queue);
  }
  void Finish() {
    ended = true;
    grpc::Status finished;
    call->Finish(&finished, nullptr);
    AwaitNext(queue);
    status = FromGrpc(finished);
  }

  LocalCalls::Impl::Running running;
  grpc::CompletionQueue queue;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call;
  grpc::ByteBuffer received;
  bool reading = false, ended = false;
  Status status;
};

LocalCalls::Stream::Stream(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
LocalCalls::Stream::~Stream() = default;

const Status& LocalCalls::Stream::status() const { return impl_->status; }

LocalCalls::Stream::Event LocalCalls::Stream::Read(double seconds, std::string* message) {
  if (impl_->ended) return Event::kEnd;
  if (!impl_->reading) impl_->call->Read(&impl_->received, nullptr);
  impl_->reading = true;
  void* tag = nullptr;
  bool ok = false;
  const auto until = std::chrono::system_clock::now() + std::chrono::microseconds(static_cast<int64_t>(seconds * 1e6));
  if (impl_->queue.AsyncNext(&tag, &ok, until) == grpc::CompletionQueue::TIMEOUT) return Event::kTimeout;
  impl_->reading = false;
  if (ok) {
    *message = TextOf(impl_->received);
    impl_->received.Clear();
    return Event::kMessage;
  }
  impl_->Finish();
  return Event::kEnd;
}

StatusOr<std::unique_ptr<LocalCalls::Stream>> LocalCalls::Open(const std::string& method, const LocalCaller& caller,
                                                               const std::string& request) {
  TESSERA_RETURN_IF_ERROR(Admit(method, caller));
  auto impl = std::make_unique<Stream::Impl>(impl_.get());
  impl_->Prepare(impl->running.context, caller);
  impl->call = impl_->stub.PrepareCall(&impl->running.context, method, &impl->queue);
  impl->call->StartCall(nullptr);
  AwaitNext(impl->queue);
  impl->call->WriteLast(BufferOf(request), grpc::WriteOptions(), nullptr);
  AwaitNext(impl->queue);  // if it fails, so does the first Read
  return std::unique_ptr<Stream>(new Stream(std::move(impl)));
}

void LocalCalls::Stop() {
  std::lock_guard lock(impl_->mutex);
  impl_->stopped = true;
  for (grpc::ClientContext* const context : impl_->running) context->TryCancel();
}

}  // namespace tessera

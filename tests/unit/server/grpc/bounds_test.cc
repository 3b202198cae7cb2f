// Limits of answers: each method with an unbounded answer has a row here and is called with more data than fits.
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/generic/generic_stub.h>

#include <limits>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/rpc/status_conversion.h"
#include "tests/support/signing_transfers.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::Message;
using google::protobuf::MessageFactory;
using google::protobuf::MethodDescriptor;
using google::protobuf::Reflection;

struct Bound {
  int64_t entries = 0;  // per message, in its list
  int64_t bytes = 0;    // per message
  bool pages = false;
};
constexpr int64_t kMiB = 1 << 20;
// A job has 1,000 files and 1,000 warnings, a task its outputs. Pages end at 2 MiB.
constexpr Bound kOneJob = {1000, 16 * kMiB}, kPages = {1000, 3 * kMiB, true};

const std::map<std::string, Bound> kBounds = {
    {"Jobs/CreateJob", kOneJob},
    {"Jobs/GetJob", kOneJob},
    {"Jobs/ListJobs", kPages},
    {"Jobs/CancelJob", kOneJob},
    {"Jobs/ChangeJob", kOneJob},
    {"Jobs/RetryJob", kOneJob},
    {"Jobs/ExportJob", kOneJob},
    {"Jobs/WatchJob", {1000, kOneJob.bytes + (64 << 10)}},  // running tasks, at most 64 KiB
    {"Jobs/ListTasks", kPages},
    {"Jobs/ListAttempts", kPages},
    {"Jobs/ListTiles", kPages},
    {"Jobs/ListViews", kPages},
    {"Jobs/ListArtifacts", kPages},
    {"Jobs/ListSettings", {100, 64 << 10}},  // a table of this release
    {"Jobs/QuoteJob", {1000, kMiB}},
    {"Workers/LeaseTask", {0, 64 * kMiB}},    // one task with its inputs
    {"Workers/ReportTask", {0, 64 * kMiB}},   // the next task
    {"Workers/Heartbeat", {3000, 4 * kMiB}},  // those of the request
    {"Workers/ListWorkers", kPages},
    {"Workers/GetDemand", {52, 64 << 10}},  // at most 32 classes and 20 tasks
    {"Blobs/StatBlobs", {1000, 4 * kMiB}},  // those of the request
    {"Blobs/ReadBlob", {0, kMiB + 100}},    // a chunk
    {"Blobs/WriteBlob", {0, 100}},
    {"Blobs/GetTransfers", {1000, 4 * kMiB}},  // those of the request; a signed URL has about 1 KiB
};

std::vector<const MethodDescriptor*> MethodsOfServices() {
  std::vector<const MethodDescriptor*> methods;
  for (const FileDescriptor* file :
       {v1::CreateJobRequest::descriptor()->file(), v1::RegisterWorkerRequest::descriptor()->file(),
        v1::ReadBlobRequest::descriptor()->file()}) {
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) methods.push_back(file->service(s)->method(m));
    }
  }
  return methods;
}

std::string NameOfCall(const MethodDescriptor& method) { return method.service()->name() + "/" + method.name(); }

// Whether messages of this type have unbounded size.
bool Grows(const Descriptor& type, std::set<const Descriptor*>& seen) {
  if (!seen.insert(&type).second) return false;
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& field = *type.field(i);
    if (field.is_repeated() || field.type() == FieldDescriptor::TYPE_BYTES) return true;
    if (field.message_type() != nullptr && Grows(*field.message_type(), seen)) return true;
  }
  return false;
}

bool NeedsBound(const MethodDescriptor& method) {
  std::set<const Descriptor*> seen;
  return method.client_streaming() || method.server_streaming() || Grows(*method.output_type(), seen);
}

TEST(Bounds, EveryUnboundedAnswerHasALimit) {
  std::set<std::string> needed;
  for (const MethodDescriptor* method : MethodsOfServices()) {
    const std::string name = NameOfCall(*method);
    const bool asks_for_pages = method->input_type()->FindFieldByName("page_size") != nullptr;
    if (!NeedsBound(*method) && !asks_for_pages) continue;
    needed.insert(name);
    ASSERT_TRUE(kBounds.contains(name)) << name << " has no row";
    const bool pages = kBounds.at(name).pages;
    EXPECT_EQ(asks_for_pages, pages) << name;
    EXPECT_EQ(method->input_type()->FindFieldByName("page_token") != nullptr, pages) << name;
    EXPECT_EQ(method->output_type()->FindFieldByName("next_page_token") != nullptr, pages) << name;
    EXPECT_EQ(method->name().starts_with("List"), pages || name == "Jobs/ListSettings") << name;
  }
  for (const auto& [name, bound] : kBounds)
    EXPECT_TRUE(needed.contains(name)) << name << " has no method with an unbounded answer";
}

// A coordinator with more objects of each kind than a page holds.
class BoundsTest : public ServerTest {
 protected:
  static constexpr int kMany = 1300;
  BoundsTest() {
    environment_.transfers = &signing_.transfers;
    RestartServer();
    for (int i = 1; i < kMany; ++i) {
      NewJob job = AJob(1);
      job.client = std::to_string(i % 2);  // a client may have a thousand
      EXPECT_TRUE(coordinator_->jobs().CreateJob(job).ok());
    }
    big_ = Create(AJob(kMany + 100));
    EXPECT_TRUE(coordinator_->jobs().ChangeJob(big_, {100, std::nullopt}).ok());
    asker_ = Register().worker();
    const auto ingest = Lease(asker_);
    EXPECT_EQ(ingest->plan.kind, "ingest");
    EXPECT_TRUE(Succeed(asker_, *ingest).ok());
    for (int i = 0; i < kMany; ++i) {
      const std::string worker = Worker();
      EXPECT_TRUE(Lease(worker).has_value());
    }
    content_.assign(3 * kMiB, 'c');
    published_ = *blobs_->PutBytes(content_);
  }

  // A request for the largest possible answer.
  std::string Request(const MethodDescriptor& method) {
    const std::unique_ptr<Message> request(
        MessageFactory::generated_factory()->GetPrototype(method.input_type())->New());
    const Reflection& of = *request->GetReflection();
    const auto set = [&](const char* field, const std::string& value) {
      const FieldDescriptor* const found = method.input_type()->FindFieldByName(field);
      if (found != nullptr) of.SetString(request.get(), found, value);
    };
    const bool ends = method.name() == "CancelJob" || method.name() == "RetryJob";
    set("name", ends ? "jobs/1" : big_);
    set("parent", big_);
    set("worker", asker_);
    set("scene_path", scene_);
    if (const FieldDescriptor* const size = method.input_type()->FindFieldByName("page_size")) {
      of.SetInt32(request.get(), size, std::numeric_limits<int32_t>::max());
    }
    if (auto* const create = dynamic_cast<v1::CreateJobRequest*>(request.get()))
      create->mutable_settings()->set_tiles(2);
    if (auto* const stat = dynamic_cast<v1::StatBlobsRequest*>(request.get())) {
      for (int i = 0; i < 1000; ++i) ToProto(published_, stat->add_digests());
    }
    if (auto* const transfers = dynamic_cast<v1::GetTransfersRequest*>(request.get())) {
      for (int i = 0; i < 1000; ++i) ToProto(published_, transfers->add_digests());
    }
    if (auto* const read = dynamic_cast<v1::ReadBlobRequest*>(request.get()))
      ToProto(published_, read->mutable_digest());
    if (auto* const beat = dynamic_cast<v1::HeartbeatRequest*>(request.get())) {
      for (int i = 0; i < 3000; ++i) beat->add_tasks()->set_task(big_ + "/tasks/" + std::to_string(i));
    }
    return request->SerializeAsString();
  }
  static void ToProto(const Digest& digest, v1::Digest* proto) {
    proto->set_sha256(digest.sha256);
    proto->set_size_bytes(digest.size_bytes);
  }
  // Up to four answers of the call.
  std::vector<std::string> Ask(const MethodDescriptor& method) {
    grpc::GenericStub stub(channel_);
    grpc::ClientContext context;
    SetDeadline(context, 60);
    As(context, asker_);
    grpc::CompletionQueue queue;
    const auto done = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    const auto call = stub.PrepareCall(&context, "/tessera.v1." + NameOfCall(method), &queue);
    call->StartCall(nullptr);
    done();
    const grpc::Slice slice(Request(method));
    call->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), nullptr);
    done();
    std::vector<std::string> answers;
    while (answers.size() < 4) {
      grpc::ByteBuffer received;
      call->Read(&received, nullptr);
      if (!done()) break;
      grpc::Slice whole;
      EXPECT_TRUE(received.DumpToSingleSlice(&whole).ok());
      answers.emplace_back(reinterpret_cast<const char*>(whole.begin()), whole.size());
      if (method.name() == "WatchJob") break;  // further answers follow changes
    }
    context.TryCancel();
    grpc::Status status;
    call->Finish(&status, nullptr);
    done();
    return answers;
  }

  ~BoundsTest() override { server_.reset(); }  // it uses signing_

  SigningTransfers signing_;
  std::string big_, asker_, content_;
  Digest published_;
};

TEST_F(BoundsTest, AnswersStayBelowTheSizeLimit) {
  for (const MethodDescriptor* method : MethodsOfServices()) {
    const auto bound = kBounds.find(NameOfCall(*method));
    if (bound == kBounds.end()) continue;
    SCOPED_TRACE(bound->first);
    const std::vector<std::string> answers = Ask(*method);
    for (const std::string& answer : answers) {
      EXPECT_LE(static_cast<int64_t>(answer.size()), bound->second.bytes);
      const std::unique_ptr<Message> message(
          MessageFactory::generated_factory()->GetPrototype(method->output_type())->New());
      ASSERT_TRUE(message->ParseFromString(answer));
      for (int i = 0; i < method->output_type()->field_count(); ++i) {
        const FieldDescriptor* const field = method->output_type()->field(i);
        if (!field->is_repeated()) continue;
        EXPECT_LE(message->GetReflection()->FieldSize(*message, field), bound->second.entries) << field->name();
      }
      if (!bound->second.pages) continue;
      const FieldDescriptor* const next = method->output_type()->FindFieldByName("next_page_token");
      if (bound->first == "Jobs/ListArtifacts") continue;  // describe_jobs_test.cc fills its pages
      EXPECT_NE(message->GetReflection()->GetString(*message, next), "") << "all data fitted in one page";
    }
    const std::set<std::string> refused = {"Jobs/RetryJob", "Jobs/ExportJob", "Jobs/ListViews", "Blobs/WriteBlob",
                                           "Workers/ReportTask"};  // ListViews: the job's survey is not one
    EXPECT_EQ(answers.empty(), refused.contains(bound->first));
  }
}

TEST_F(BoundsTest, OversizedMessagesAreRefused) {
  grpc::ClientContext context;
  v1::GetJobRequest request;
  request.set_name(std::string(5 * kMiB, 'x'));
  v1::Job job;
  EXPECT_EQ(FromGrpc(jobs_->GetJob(&context, request, &job)).code(), absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace tessera

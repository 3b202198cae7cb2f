// Workers, clients and stored records of the last release are understood: nothing that released.txtpb has is gone or
// means something else. More is fine.
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

namespace tessera {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::DescriptorProto;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::FileDescriptorProto;
using google::protobuf::FileDescriptorSet;
using google::protobuf::MethodDescriptor;
using google::protobuf::ServiceDescriptor;
using testing::HasSubstr;

using Faults = std::vector<std::string>;

std::string TypeOf(const FieldDescriptor& field) {
  if (field.message_type() != nullptr) return field.message_type()->full_name();
  if (field.enum_type() != nullptr) return field.enum_type()->full_name();
  return field.type_name();
}

// What of a field is seen on the wire or in JSON.
std::string Meaning(const FieldDescriptor& field) {
  const auto* const oneof = field.real_containing_oneof();
  return std::string(field.is_repeated() ? "repeated " : "") + (field.has_optional_keyword() ? "optional " : "") +
         TypeOf(field) + " " + field.json_name() + (oneof != nullptr ? " in oneof " + oneof->name() : "");
}

// Names of enum values are not compared: they are on no wire and in no record, numbers are.
void CompareEnum(const EnumDescriptor& before, const DescriptorPool& now, Faults* faults) {
  const EnumDescriptor* const found = now.FindEnumTypeByName(before.full_name());
  if (found == nullptr) return faults->push_back(before.full_name() + " is gone");
  for (int i = 0; i < before.value_count(); ++i) {
    const int number = before.value(i)->number();
    if (found->FindValueByNumber(number) == nullptr) {
      faults->push_back(before.full_name() + " has no value " + std::to_string(number) + " any more");
    }
  }
  for (int i = 0; i < found->value_count(); ++i) {
    if (before.IsReservedNumber(found->value(i)->number())) {
      faults->push_back(found->value(i)->full_name() + " reuses a number");
    }
  }
}

void CompareMessage(const Descriptor& before, const DescriptorPool& now, Faults* faults) {
  const Descriptor* const found = now.FindMessageTypeByName(before.full_name());
  if (found == nullptr) return faults->push_back(before.full_name() + " is gone");
  for (int i = 0; i < before.field_count(); ++i) {
    const FieldDescriptor& field = *before.field(i);
    const FieldDescriptor* const same = found->FindFieldByNumber(field.number());
    if (same == nullptr) {
      faults->push_back(field.full_name() + " is gone: number " + std::to_string(field.number()));
    } else if (Meaning(*same) != Meaning(field)) {
      faults->push_back(before.full_name() + " field " + std::to_string(field.number()) + ": found " + Meaning(*same) +
                        ", expected " + Meaning(field));
    }
  }
  for (int i = 0; i < found->field_count(); ++i) {
    if (before.IsReservedNumber(found->field(i)->number())) {
      faults->push_back(found->field(i)->full_name() + " reuses a number");
    }
  }
  for (int i = 0; i < before.nested_type_count(); ++i) CompareMessage(*before.nested_type(i), now, faults);
  for (int i = 0; i < before.enum_type_count(); ++i) CompareEnum(*before.enum_type(i), now, faults);
}

std::string Meaning(const MethodDescriptor& method) {
  const auto side = [](bool streams, const Descriptor& type) { return (streams ? "stream " : "") + type.full_name(); };
  return side(method.client_streaming(), *method.input_type()) + " -> " +
         side(method.server_streaming(), *method.output_type());
}

void CompareService(const ServiceDescriptor& before, const DescriptorPool& now, Faults* faults) {
  const ServiceDescriptor* const found = now.FindServiceByName(before.full_name());
  if (found == nullptr) return faults->push_back(before.full_name() + " is gone");
  for (int i = 0; i < before.method_count(); ++i) {
    const MethodDescriptor& method = *before.method(i);
    const MethodDescriptor* const same = found->FindMethodByName(method.name());
    if (same == nullptr) {
      faults->push_back(method.full_name() + " is gone");
    } else if (Meaning(*same) != Meaning(method)) {
      faults->push_back(method.full_name() + ": found " + Meaning(*same) + ", expected " + Meaning(method));
    }
  }
}

// What of the files `before` has another meaning in `now`.
Faults Incompatibilities(const FileDescriptorSet& before, const DescriptorPool& now) {
  DescriptorPool pool;
  Faults faults;
  for (const FileDescriptorProto& proto : before.file()) {
    const FileDescriptor* const file = pool.BuildFile(proto);
    if (file == nullptr) return {proto.name() + " is no descriptor"};
    if (file->package() != "tessera.v1") continue;
    for (int i = 0; i < file->message_type_count(); ++i) CompareMessage(*file->message_type(i), now, &faults);
    for (int i = 0; i < file->enum_type_count(); ++i) CompareEnum(*file->enum_type(i), now, &faults);
    for (int i = 0; i < file->service_count(); ++i) CompareService(*file->service(i), now, &faults);
  }
  return faults;
}

std::string Content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return std::string((std::istreambuf_iterator<char>(file)), {});
}

FileDescriptorSet Released() {
  FileDescriptorSet released;
  const std::string text = Content(TESSERA_SOURCE_DIR "/tests/unit/proto/released.txtpb");
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &released));
  EXPECT_GE(released.file_size(), 5);
  return released;
}

TEST(ProtoCompatibility, WhatWasReleasedIsUnderstood) {
  FileDescriptorSet files;
  ASSERT_TRUE(files.ParseFromString(Content(TESSERA_PROTO_TODAY)));
  DescriptorPool today;
  for (const FileDescriptorProto& file : files.file()) ASSERT_NE(today.BuildFile(file), nullptr) << file.name();
  for (const std::string& fault : Incompatibilities(Released(), today)) ADD_FAILURE() << fault;
}

// The comparison itself: each change of what was released is told.
class ProtoChange : public testing::Test {
 protected:
  template <class Named>
  static Named& ByName(google::protobuf::RepeatedPtrField<Named>* all, const std::string& name) {
    for (Named& each : *all) {
      if (each.name() == name) return each;
    }
    ADD_FAILURE() << "no " << name;
    return *all->Add();
  }
  // What is told of files in which `change` was done to the message of jobs.proto.
  static Faults AfterChange(const std::string& message, const std::function<void(DescriptorProto&)>& change) {
    return After([&](FileDescriptorProto& jobs) { change(ByName(jobs.mutable_message_type(), message)); });
  }
  static Faults After(const std::function<void(FileDescriptorProto&)>& change) {
    const FileDescriptorSet released = Released();
    FileDescriptorSet changed = released;
    change(ByName(changed.mutable_file(), "tessera/v1/jobs.proto"));
    DescriptorPool now;
    for (const FileDescriptorProto& proto : changed.file()) {
      EXPECT_NE(now.BuildFile(proto), nullptr) << "the change is no descriptor";
    }
    return Incompatibilities(released, now);
  }
  static void ExpectFault(const Faults& faults, const std::string& what) {
    ASSERT_EQ(faults.size(), 1u) << what;
    EXPECT_THAT(faults[0], HasSubstr(what));
  }
};

TEST_F(ProtoChange, NoneAndMoreAreFine) {
  EXPECT_TRUE(After([](FileDescriptorProto&) {}).empty());
  EXPECT_TRUE(AfterChange("ListJobsRequest", [](DescriptorProto& message) {
                auto& field = *message.add_field();
                field.set_name("order_by");
                field.set_number(3);
                field.set_type(google::protobuf::FieldDescriptorProto::TYPE_STRING);
                field.set_label(google::protobuf::FieldDescriptorProto::LABEL_OPTIONAL);
              }).empty());
  EXPECT_TRUE(After([](FileDescriptorProto& jobs) {
                auto& state = ByName(jobs.mutable_enum_type(), "JobState");
                state.mutable_value(1)->set_name("JOB_STATE_QUEUED");
                auto& value = *state.add_value();
                value.set_name("JOB_STATE_NEW");
                value.set_number(100);
              }).empty());
}

TEST_F(ProtoChange, OfFieldsIsTold) {
  ExpectFault(AfterChange("GetJobRequest", [](DescriptorProto& message) { message.clear_field(); }), "is gone");
  ExpectFault(AfterChange("GetJobRequest", [](DescriptorProto& message) { message.mutable_field(0)->set_number(2); }),
              "is gone");
  ExpectFault(AfterChange("GetJobRequest",
                          [](DescriptorProto& message) {
                            message.mutable_field(0)->set_type(google::protobuf::FieldDescriptorProto::TYPE_BYTES);
                          }),
              "found bytes name, expected string name");
  ExpectFault(AfterChange("GetJobRequest",
                          [](DescriptorProto& message) {
                            message.mutable_field(0)->set_label(google::protobuf::FieldDescriptorProto::LABEL_REPEATED);
                          }),
              "found repeated string");
  ExpectFault(
      AfterChange("GetJobRequest", [](DescriptorProto& message) { message.mutable_field(0)->set_json_name("other"); }),
      "found string other");
  ExpectFault(AfterChange("MethodSettings",
                          [](DescriptorProto& message) {
                            message.clear_reserved_range();
                            auto& field = *message.add_field();
                            field.set_name("again");
                            field.set_number(13);
                            field.set_type(google::protobuf::FieldDescriptorProto::TYPE_STRING);
                            field.set_label(google::protobuf::FieldDescriptorProto::LABEL_OPTIONAL);
                          }),
              "reuses a number");
}

TEST_F(ProtoChange, OfAllElseIsTold) {
  ExpectFault(After([](FileDescriptorProto& jobs) {
                auto& state = ByName(jobs.mutable_enum_type(), "JobState");
                state.mutable_value(state.value_size() - 1)->set_number(77);
              }),
              "has no value 6");
  const auto jobs_service = [](FileDescriptorProto & jobs) -> auto& { return *jobs.mutable_service(0); };
  ExpectFault(After([&](FileDescriptorProto& jobs) { jobs_service(jobs).mutable_method()->RemoveLast(); }),
              "ListAttempts is gone");
  ExpectFault(After([&](FileDescriptorProto& jobs) {
                ByName(jobs_service(jobs).mutable_method(), "WatchJob").set_server_streaming(false);
              }),
              "expected tessera.v1.WatchJobRequest -> stream");
  ExpectFault(After([&](FileDescriptorProto& jobs) {
                ByName(jobs_service(jobs).mutable_method(), "CancelJob").set_input_type(".tessera.v1.GetJobRequest");
              }),
              "found tessera.v1.GetJobRequest");
  ExpectFault(After([&](FileDescriptorProto& jobs) { jobs.clear_service(); }), "tessera.v1.Jobs is gone");
}

}  // namespace
}  // namespace tessera

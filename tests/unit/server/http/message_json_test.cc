#include "server/http/message_json.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/dynamic_message.h>
#include <google/protobuf/timestamp.pb.h>
#include <google/protobuf/util/json_util.h>

#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <vector>

#include "tessera/v1/blobs.pb.h"
#include "tessera/v1/errors.pb.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/records.pb.h"
#include "tessera/v1/tasks.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FieldDescriptorProto;
using google::protobuf::FileDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;
using google::protobuf::Timestamp;
using nlohmann::json;

std::string JsonOfProtobuf(const Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  std::string text;
  const auto printed = google::protobuf::util::MessageToJsonString(message, &text, options);
  EXPECT_TRUE(printed.ok()) << printed.message() << "\n" << message.DebugString();
  return text;
}

// Fills messages with values that are difficult to print.
class RandomMessages {
 public:
  explicit RandomMessages(unsigned seed) : random_(seed) {}

  void Fill(Message* message, int depth) {
    if (message->GetDescriptor() == Timestamp::descriptor()) return FillTimestamp(static_cast<Timestamp*>(message));
    const Descriptor& type = *message->GetDescriptor();
    for (int i = 0; i < type.field_count(); ++i) {
      const FieldDescriptor& field = *type.field(i);
      const bool nested = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
      if (nested && depth == 0) continue;
      const int count = field.is_repeated() ? Below(3) : Below(4) > 0 ? 1 : 0;
      for (int k = 0; k < count; ++k) Set(message, field, depth);
    }
  }

 private:
  int Below(int n) { return static_cast<int>(random_() % static_cast<unsigned>(n)); }
  template <typename T>
  T OneOf(const std::vector<T>& values) {
    return values[static_cast<size_t>(Below(static_cast<int>(values.size())))];
  }

  void FillTimestamp(Timestamp* time) {
    time->set_seconds(OneOf<int64_t>({0, -1, 1'700'000'000, 253'402'300'799, -62'135'596'800}));
    time->set_nanos(OneOf<int>({0, 1, 1000, 120'000'000, 999'999'999}));
  }

  std::string Text() {
    static const std::vector<std::string> kParts = {"a",
                                                    "Dorf",
                                                    "\"",
                                                    "\\",
                                                    "/",
                                                    "<b>&'",
                                                    "\n\t\r\b\f",
                                                    std::string(1, '\0'),
                                                    "\x01\x1F",
                                                    "\x7F",
                                                    "\xC2\x80",
                                                    "\xC3\xA4",
                                                    "\xE2\x80\xA8",
                                                    "\xE2\x80\xA9",
                                                    "\xEF\xBB\xBF",
                                                    "\xED\x9F\xBF",
                                                    "\xEE\x80\x80",
                                                    "\xEF\xBF\xBF",
                                                    "\xF0\x9F\x8F\xA0",
                                                    "\xF4\x8F\xBF\xBF",
                                                    "\xE0\xA0\x80",
                                                    "\xC2\xAD",
                                                    "\xD8\x9C"};
    std::string text;
    for (int n = Below(6); n > 0; --n) text += OneOf(kParts);
    return text;
  }
  std::string Bytes() {
    std::string bytes;
    for (int n = Below(8); n > 0; --n) bytes.push_back(static_cast<char>(Below(256)));
    return bytes;
  }
  double Real() {
    using Limits = std::numeric_limits<double>;
    if (Below(2) == 0) return std::uniform_real_distribution(-1e3, 1e3)(random_);
    return OneOf<double>({0.1, 1.0 / 3, 5, 1e15, 1e22, -1e300, 4.9e-324, Limits::max(), Limits::min(),
                          Limits::infinity(), -Limits::infinity(), Limits::quiet_NaN()});
  }
  template <typename Integer>
  Integer Whole() {
    using Limits = std::numeric_limits<Integer>;
    return OneOf<Integer>({0, 1, 42, Limits::max(), Limits::min(), static_cast<Integer>(random_())});
  }

  void Set(Message* message, const FieldDescriptor& field, int depth) {
    const Reflection& fields = *message->GetReflection();
    const auto put = [&](auto add, auto set, auto value) {
      field.is_repeated() ? (fields.*add)(message, &field, value) : (fields.*set)(message, &field, value);
    };
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_INT32:
        return put(&Reflection::AddInt32, &Reflection::SetInt32, Whole<int32_t>());
      case FieldDescriptor::CPPTYPE_UINT32:
        return put(&Reflection::AddUInt32, &Reflection::SetUInt32, Whole<uint32_t>());
      case FieldDescriptor::CPPTYPE_INT64:
        return put(&Reflection::AddInt64, &Reflection::SetInt64, Whole<int64_t>());
      case FieldDescriptor::CPPTYPE_UINT64:
        return put(&Reflection::AddUInt64, &Reflection::SetUInt64, Whole<uint64_t>());
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return put(&Reflection::AddDouble, &Reflection::SetDouble, Real());
      case FieldDescriptor::CPPTYPE_FLOAT:
        return put(&Reflection::AddFloat, &Reflection::SetFloat, OneOf<float>({0, 0.5F, -1e10F, 0.1F}));
      case FieldDescriptor::CPPTYPE_BOOL:
        return put(&Reflection::AddBool, &Reflection::SetBool, Below(2) == 1);
      case FieldDescriptor::CPPTYPE_ENUM:
        return put(&Reflection::AddEnumValue, &Reflection::SetEnumValue, Below(field.enum_type()->value_count() + 1));
      case FieldDescriptor::CPPTYPE_STRING: {
        const std::string value = field.type() == FieldDescriptor::TYPE_BYTES ? Bytes() : Text();
        field.is_repeated() ? fields.AddString(message, &field, value) : fields.SetString(message, &field, value);
        return;
      }
      case FieldDescriptor::CPPTYPE_MESSAGE:
        if (field.is_map()) return SetEntry(message, field);
        return Fill(field.is_repeated() ? fields.AddMessage(message, &field) : fields.MutableMessage(message, &field),
                    depth - 1);
    }
  }
  void SetEntry(Message* message, const FieldDescriptor& field) {
    Message* const entry = message->GetReflection()->AddMessage(message, &field);
    Set(entry, *entry->GetDescriptor()->map_key(), 1);
    Set(entry, *entry->GetDescriptor()->map_value(), 1);
  }

  std::mt19937_64 random_;
};

void ExpectSame(const Message& message) {
  const json expected = json::parse(JsonOfProtobuf(message)), found = json::parse(JsonOfMessage(message));
  ASSERT_EQ(found, expected) << json::diff(expected, found);
}

void CollectTypes(const Descriptor& type, std::set<const Descriptor*>* types) {
  if (!type.options().map_entry()) types->insert(&type);
  for (int i = 0; i < type.nested_type_count(); ++i) CollectTypes(*type.nested_type(i), types);
}

TEST(MessageJsonTest, EqualsThatOfProtobufForEveryMessageOfTheApi) {
  std::set<const Descriptor*> types;
  for (const Descriptor* const one :
       {v1::Job::descriptor(), v1::Task::descriptor(), v1::Worker::descriptor(), v1::Digest::descriptor(),
        v1::ReadBlobRequest::descriptor(), v1::Record::descriptor(), v1::Refusal::descriptor()}) {
    for (int i = 0; i < one->file()->message_type_count(); ++i) CollectTypes(*one->file()->message_type(i), &types);
  }
  EXPECT_GT(types.size(), 80U);
  unsigned seed = 0;
  for (const Descriptor* const type : types) {
    SCOPED_TRACE(type->full_name());
    const std::unique_ptr<Message> message(
        google::protobuf::MessageFactory::generated_factory()->GetPrototype(type)->New());
    ExpectSame(*message);
    for (int i = 0; i < 100 && !HasFatalFailure(); ++i) {
      message->Clear();
      RandomMessages(++seed).Fill(message.get(), 3);
      ExpectSame(*message);
    }
  }
}

// The API does not have all types of fields yet.
TEST(MessageJsonTest, EqualsThatOfProtobufForEveryTypeOfFields) {
  google::protobuf::FileDescriptorProto file;
  file.set_name("all.proto");
  file.set_syntax("proto3");
  auto& type = *file.add_message_type();
  type.set_name("All");
  int number = 0;
  const auto add = [&](google::protobuf::DescriptorProto& to, int of, FieldDescriptorProto::Label label) {
    FieldDescriptorProto& field = *to.add_field();
    field.set_name("field_" + std::to_string(++number));
    field.set_number(number);
    field.set_type(static_cast<FieldDescriptorProto::Type>(of));
    field.set_label(label);
    return &field;
  };
  for (int of = 1; of <= FieldDescriptorProto::Type_MAX; ++of) {
    if (of == FieldDescriptorProto::TYPE_GROUP || of == FieldDescriptorProto::TYPE_MESSAGE ||
        of == FieldDescriptorProto::TYPE_ENUM) {
      continue;
    }
    add(type, of, FieldDescriptorProto::LABEL_OPTIONAL);
    add(type, of, FieldDescriptorProto::LABEL_REPEATED);
    if (of == FieldDescriptorProto::TYPE_DOUBLE || of == FieldDescriptorProto::TYPE_FLOAT ||
        of == FieldDescriptorProto::TYPE_BYTES) {
      continue;
    }
    auto* const map = add(type, FieldDescriptorProto::TYPE_MESSAGE, FieldDescriptorProto::LABEL_REPEATED);
    map->set_type_name(".All.Field" + std::to_string(number) + "Entry");
    auto& entry = *type.add_nested_type();
    entry.set_name("Field" + std::to_string(number) + "Entry");
    entry.mutable_options()->set_map_entry(true);
    const int kept = std::exchange(number, 0);
    add(entry, of, FieldDescriptorProto::LABEL_OPTIONAL)->set_name("key");
    add(entry, FieldDescriptorProto::TYPE_STRING, FieldDescriptorProto::LABEL_OPTIONAL)->set_name("value");
    number = kept;
  }
  google::protobuf::DescriptorPool pool;
  const FileDescriptor* const built = pool.BuildFile(file);
  ASSERT_NE(built, nullptr);
  google::protobuf::DynamicMessageFactory factory(&pool);
  const std::unique_ptr<Message> message(factory.GetPrototype(built->message_type(0))->New());
  ExpectSame(*message);
  for (unsigned seed = 0; seed < 300 && !HasFatalFailure(); ++seed) {
    message->Clear();
    RandomMessages(seed).Fill(message.get(), 2);
    ExpectSame(*message);
  }
}

TEST(MessageJsonTest, BytesThatAreNotUtf8AreReplaced) {
  v1::Job job;
  for (const std::string bad : {"\x80", "\xFF", "\xC0\x80", "\xC2", "\xE0\x80\x80", "\xED\xA0\x80", "\xE2\x82",
                                "\xF0\x80\x80\x80", "\xF4\x90\x80\x80", "\xF5\x80\x80\x80"}) {
    job.set_display_name("a" + bad + "b");
    const json parsed = json::parse(JsonOfMessage(job), nullptr, false);
    ASSERT_FALSE(parsed.is_discarded()) << testing::PrintToString(bad);
    std::string replaced = "a";
    for (size_t i = 0; i < bad.size(); ++i) replaced += "\xEF\xBF\xBD";
    EXPECT_EQ(parsed["displayName"], replaced + "b");
  }
}

TEST(MessageJsonTest, NoTextEndsAScript) {
  v1::Job job;
  job.set_error("</script><script>alert(1)</script>");
  EXPECT_THAT(JsonOfMessage(job), testing::Not(testing::HasSubstr("<")));
}

}  // namespace
}  // namespace tessera

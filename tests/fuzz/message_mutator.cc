#include "tests/fuzz/message_mutator.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/stubs/logging.h>

#include <cstring>
#include <iterator>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/frames.h"

// libFuzzer's own.
extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace tessera {
namespace {

// It would write a line for each of the many strings that are not UTF-8.
[[maybe_unused]] const bool kSilent = (google::protobuf::SetLogHandler(nullptr), true);

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

// Names of what there may be, and what looks like them.
constexpr const char* kTexts[] = {"",
                                  "jobs/1",
                                  "jobs/2",
                                  "jobs/0",
                                  "jobs/2147483648",
                                  "jobs/1/tasks/0",
                                  "jobs/1/tasks/1",
                                  "jobs/1/tasks/2",
                                  "jobs/2/tasks/0",
                                  "workers/1",
                                  "workers/1-1",
                                  "scene.json",
                                  "survey.json",
                                  "mesh",
                                  "refined",
                                  "{}",
                                  "{\"a\":[1,{}]}",
                                  "tessera",
                                  "../../etc/passwd",
                                  "/scene",
                                  "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a",
                                  "\n\x1b[2J\xff\xfe"};
constexpr int64_t kNumbers[] = {0,
                                1,
                                2,
                                3,
                                -1,
                                7,
                                100,
                                1000,
                                1001,
                                65536,
                                std::numeric_limits<int32_t>::max(),
                                std::numeric_limits<int32_t>::min(),
                                std::numeric_limits<int64_t>::max(),
                                std::numeric_limits<int64_t>::min()};
constexpr double kReals[] = {0, 1, -1, 0.5, 1e300, -1e300, 1e-300};

class Mutator {
 public:
  explicit Mutator(unsigned seed) : random_(seed) {}

  size_t Below(size_t count) { return std::uniform_int_distribution<size_t>(0, count - 1)(random_); }

  std::string Text(const std::string& old) {
    if (Below(2) == 0) return kTexts[Below(std::size(kTexts))];
    std::string text = old;
    text.resize(old.size() + 16);
    text.resize(LLVMFuzzerMutate(reinterpret_cast<uint8_t*>(text.data()), old.size(), text.size()));
    return text;
  }

  void Change(Message& message, int depth) {
    const google::protobuf::Descriptor& type = *message.GetDescriptor();
    if (type.field_count() == 0) return;
    // What is set is changed more often than what is not, so that messages stay what they are.
    std::vector<const FieldDescriptor*> set;
    message.GetReflection()->ListFields(message, &set);
    const FieldDescriptor* const field = !set.empty() && Below(4) != 0
                                             ? set[Below(set.size())]
                                             : type.field(static_cast<int>(Below(type.field_count())));
    if (field->is_repeated()) return ChangeRepeated(message, field, depth);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      if (Below(16) == 0) return message.GetReflection()->ClearField(&message, field);
      Message& inner = *message.GetReflection()->MutableMessage(&message, field);
      if (depth < 6) Change(inner, depth + 1);
      return;
    }
    SetScalar(message, field);
  }

 private:
  void ChangeRepeated(Message& message, const FieldDescriptor* field, int depth) {
    const Reflection& of = *message.GetReflection();
    const int count = of.FieldSize(message, field);
    const size_t what = Below(4);
    if (count > 1 && what == 0) return of.SwapElements(&message, field, static_cast<int>(Below(count)), count - 1);
    if (count > 0 && what == 1) return of.RemoveLast(&message, field);
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return AddScalar(message, field);
    if (count > 0 && what == 2) {
      const std::unique_ptr<Message> copy(of.GetRepeatedMessage(message, field, 0).New());
      copy->CopyFrom(of.GetRepeatedMessage(message, field, static_cast<int>(Below(count))));
      of.AddMessage(&message, field)->CopyFrom(*copy);
      return;
    }
    Message& inner = count > 0 ? *of.MutableRepeatedMessage(&message, field, static_cast<int>(Below(count)))
                               : *of.AddMessage(&message, field);
    if (depth < 6) Change(inner, depth + 1);
  }

  int64_t Number(int64_t old) {
    const size_t what = Below(3);
    return what == 0 ? kNumbers[Below(std::size(kNumbers))]
                     : static_cast<int64_t>(static_cast<uint64_t>(old) + (what == 1 ? 1 : ~uint64_t{0}));
  }
  int EnumNumber(const FieldDescriptor* field) {
    const size_t which = Below(field->enum_type()->value_count() + 1);
    return which == 0 ? 99 : field->enum_type()->value(static_cast<int>(which) - 1)->number();
  }
  double Real() { return Below(8) == 0 ? std::numeric_limits<double>::quiet_NaN() : kReals[Below(std::size(kReals))]; }

  void SetScalar(Message& message, const FieldDescriptor* field) {
    const Reflection& of = *message.GetReflection();
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_INT32:
        return of.SetInt32(&message, field, static_cast<int32_t>(Number(of.GetInt32(message, field))));
      case FieldDescriptor::CPPTYPE_INT64:
        return of.SetInt64(&message, field, Number(of.GetInt64(message, field)));
      case FieldDescriptor::CPPTYPE_UINT64:
        return of.SetUInt64(&message, field, static_cast<uint64_t>(Number(1)));
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return of.SetDouble(&message, field, Real());
      case FieldDescriptor::CPPTYPE_BOOL:
        return of.SetBool(&message, field, !of.GetBool(message, field));
      case FieldDescriptor::CPPTYPE_ENUM:
        return of.SetEnumValue(&message, field, EnumNumber(field));
      case FieldDescriptor::CPPTYPE_STRING:
        return of.SetString(&message, field, Text(of.GetString(message, field)));
      default:
        return;
    }
  }
  void AddScalar(Message& message, const FieldDescriptor* field) {
    const Reflection& of = *message.GetReflection();
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_INT32:
        return of.AddInt32(&message, field, static_cast<int32_t>(Number(1)));
      case FieldDescriptor::CPPTYPE_BOOL:
        return of.AddBool(&message, field, true);
      case FieldDescriptor::CPPTYPE_STRING:
        return of.AddString(&message, field, Text(""));
      default:
        return;
    }
  }

  std::mt19937 random_;
};

}  // namespace

size_t MutateFrames(uint8_t* data, size_t size, size_t max_size, unsigned seed, int kinds,
                    const std::function<const google::protobuf::Message*(uint8_t)>& prototype) {
  Mutator mutator(seed);
  if (size == 0 || mutator.Below(16) == 0) return LLVMFuzzerMutate(data, size, max_size);
  std::vector<InputFrame> frames = SplitFrames(std::string(reinterpret_cast<const char*>(data), size));
  if (frames.empty()) frames.emplace_back();
  const size_t at = mutator.Below(frames.size()), what = mutator.Below(12);
  if (what == 0 && frames.size() > 1) {
    frames.erase(frames.begin() + static_cast<ptrdiff_t>(at));
  } else if (what == 1) {
    frames.insert(frames.begin() + static_cast<ptrdiff_t>(mutator.Below(frames.size() + 1)), InputFrame(frames[at]));
  } else if (what == 2) {
    std::swap(frames[at], frames[mutator.Below(frames.size())]);
  } else if (what == 3) {
    frames[at].kind = static_cast<uint8_t>(mutator.Below(static_cast<size_t>(kinds)));
  } else {
    const google::protobuf::Message* const type = prototype(frames[at].kind);
    const std::unique_ptr<google::protobuf::Message> message(type == nullptr ? nullptr : type->New());
    if (message != nullptr && message->ParseFromString(frames[at].bytes)) {
      for (size_t i = mutator.Below(3) + 1; i > 0; --i) mutator.Change(*message, 0);
      frames[at].bytes = message->SerializePartialAsString();
    } else {
      frames[at].bytes = mutator.Text(frames[at].bytes);
    }
  }
  const std::string joined = JoinFrames(frames);
  if (joined.size() > max_size) return LLVMFuzzerMutate(data, size, max_size);
  std::memcpy(data, joined.data(), joined.size());
  return joined.size();
}

}  // namespace tessera

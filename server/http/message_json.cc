#include "server/http/message_json.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/timestamp.pb.h>
#include <google/protobuf/util/time_util.h>

#include <charconv>
#include <cmath>
#include <string_view>

#include "absl/strings/escaping.h"

namespace tessera {
namespace {

using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;
using google::protobuf::Timestamp;

constexpr size_t kLargestRatio = 8;  // of JSON to the serialized message, mostly: names and defaults are longer

template <typename Number>
void AddNumber(Number value, std::string* json) {
  char digits[32];
  json->append(digits, std::to_chars(digits, digits + sizeof(digits), value).ptr);
}

// Number of bytes of the UTF-8 sequence that `text` starts with; 0: there is none.
size_t SequenceSize(std::string_view text) {
  const auto at = [&](size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U; };
  const auto continues = [&](size_t i) { return (at(i) & 0xC0) == 0x80; };
  const unsigned first = at(0), second = at(1);
  if (first < 0x80) return 1;
  if (first >= 0xC2 && first < 0xE0 && continues(1)) return 2;
  if (first >= 0xE0 && first < 0xF0 && continues(1) && continues(2)) {
    const bool overlong = first == 0xE0 && second < 0xA0, surrogate = first == 0xED && second >= 0xA0;
    return overlong || surrogate ? 0 : 3;
  }
  if (first >= 0xF0 && first < 0xF5 && continues(1) && continues(2) && continues(3)) {
    const bool overlong = first == 0xF0 && second < 0x90, too_large = first == 0xF4 && second >= 0x90;
    return overlong || too_large ? 0 : 4;
  }
  return 0;
}

void AddString(std::string_view text, std::string* json) {
  constexpr char kHex[] = "0123456789abcdef";
  json->push_back('"');
  for (size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '"' || c == '\\') {
      json->push_back('\\');
      json->push_back(c);
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F || c == '<' || c == '>') {
      json->append("\\u00");  // "<" and ">": so that no text ends a script in HTML
      json->push_back(kHex[c >> 4]);
      json->push_back(kHex[c & 15]);
    } else if (static_cast<unsigned char>(c) >= 0x80) {
      const size_t size = SequenceSize(text.substr(i));
      json->append(size == 0 ? std::string_view("\xEF\xBF\xBD") : text.substr(i, size));
      i += size == 0 ? 1 : size;
      continue;
    } else {
      json->push_back(c);
    }
    ++i;
  }
  json->push_back('"');
}

template <typename Real>
void AddReal(Real value, std::string* json) {
  if (std::isfinite(value)) return AddNumber(value, json);
  json->append(std::isnan(value) ? "\"NaN\"" : value > 0 ? "\"Infinity\"" : "\"-Infinity\"");
}

template <typename Integer>
void AddLongInteger(Integer value, std::string* json) {
  json->push_back('"');
  AddNumber(value, json);
  json->push_back('"');
}

void AddMessage(const Message& message, std::string* json);

// The value of a field; of a repeated one, its element `i`.
void AddValue(const Message& message, const FieldDescriptor& field, int i, std::string* json) {
  const Reflection& fields = *message.GetReflection();
  const bool repeated = field.is_repeated();
  std::string buffer;
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
      return AddNumber(repeated ? fields.GetRepeatedInt32(message, &field, i) : fields.GetInt32(message, &field), json);
    case FieldDescriptor::CPPTYPE_UINT32:
      return AddNumber(repeated ? fields.GetRepeatedUInt32(message, &field, i) : fields.GetUInt32(message, &field),
                       json);
    case FieldDescriptor::CPPTYPE_INT64:
      return AddLongInteger(repeated ? fields.GetRepeatedInt64(message, &field, i) : fields.GetInt64(message, &field),
                            json);
    case FieldDescriptor::CPPTYPE_UINT64:
      return AddLongInteger(repeated ? fields.GetRepeatedUInt64(message, &field, i) : fields.GetUInt64(message, &field),
                            json);
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return AddReal(repeated ? fields.GetRepeatedDouble(message, &field, i) : fields.GetDouble(message, &field), json);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return AddReal(repeated ? fields.GetRepeatedFloat(message, &field, i) : fields.GetFloat(message, &field), json);
    case FieldDescriptor::CPPTYPE_BOOL: {
      const bool value = repeated ? fields.GetRepeatedBool(message, &field, i) : fields.GetBool(message, &field);
      json->append(value ? "true" : "false");
      return;
    }
    case FieldDescriptor::CPPTYPE_ENUM: {
      const int number =
          repeated ? fields.GetRepeatedEnumValue(message, &field, i) : fields.GetEnumValue(message, &field);
      const EnumValueDescriptor* const value = field.enum_type()->FindValueByNumber(number);
      return value == nullptr ? AddNumber(number, json) : AddString(value->name(), json);
    }
    case FieldDescriptor::CPPTYPE_STRING: {
      const std::string& value = repeated ? fields.GetRepeatedStringReference(message, &field, i, &buffer)
                                          : fields.GetStringReference(message, &field, &buffer);
      return AddString(field.type() == FieldDescriptor::TYPE_BYTES ? absl::Base64Escape(value) : value, json);
    }
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return AddMessage(repeated ? fields.GetRepeatedMessage(message, &field, i) : fields.GetMessage(message, &field),
                        json);
  }
}

void AddMap(const Message& message, const FieldDescriptor& field, std::string* json) {
  const Reflection& fields = *message.GetReflection();
  const FieldDescriptor& key = *field.message_type()->map_key();
  json->push_back('{');
  for (int i = 0; i < fields.FieldSize(message, &field); ++i) {
    if (i > 0) json->push_back(',');
    const Message& entry = fields.GetRepeatedMessage(message, &field, i);
    const bool quoted = key.cpp_type() != FieldDescriptor::CPPTYPE_STRING &&
                        key.cpp_type() != FieldDescriptor::CPPTYPE_INT64 &&
                        key.cpp_type() != FieldDescriptor::CPPTYPE_UINT64;
    if (quoted) json->push_back('"');
    AddValue(entry, key, 0, json);
    if (quoted) json->push_back('"');
    json->push_back(':');
    AddValue(entry, *field.message_type()->map_value(), 0, json);
  }
  json->push_back('}');
}

void AddRepeated(const Message& message, const FieldDescriptor& field, std::string* json) {
  json->push_back('[');
  for (int i = 0; i < message.GetReflection()->FieldSize(message, &field); ++i) {
    if (i > 0) json->push_back(',');
    AddValue(message, field, i, json);
  }
  json->push_back(']');
}

void AddMessage(const Message& message, std::string* json) {
  if (message.GetDescriptor() == Timestamp::descriptor()) {
    return AddString(google::protobuf::util::TimeUtil::ToString(static_cast<const Timestamp&>(message)), json);
  }
  json->push_back('{');
  bool first = true;
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor& field = *message.GetDescriptor()->field(i);
    if (field.has_presence() && !message.GetReflection()->HasField(message, &field)) continue;
    if (!first) json->push_back(',');
    first = false;
    json->push_back('"');
    json->append(field.json_name());
    json->append("\":");
    field.is_map()        ? AddMap(message, field, json)
    : field.is_repeated() ? AddRepeated(message, field, json)
                          : AddValue(message, field, 0, json);
  }
  json->push_back('}');
}

}  // namespace

std::string JsonOfMessage(const Message& message) {
  std::string json;
  json.reserve(kLargestRatio * message.ByteSizeLong());
  AddMessage(message, &json);
  return json;
}

}  // namespace tessera

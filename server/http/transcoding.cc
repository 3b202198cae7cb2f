#include "server/http/transcoding.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "server/http/message_json.h"

namespace tessera {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::MessageFactory;
using google::protobuf::MethodDescriptor;

// Null if there is none.
const MethodDescriptor* MethodOf(std::string_view rpc) {
  std::string name(rpc.substr(1));  // tessera.v1.Jobs/ListTiles
  std::replace(name.begin(), name.end(), '/', '.');
  return DescriptorPool::generated_pool()->FindMethodByName(name);
}

std::unique_ptr<Message> NewMessage(const Descriptor& type) {
  return std::unique_ptr<Message>(MessageFactory::generated_factory()->GetPrototype(&type)->New());
}

Status NoMethod(std::string_view rpc) { return absl::UnimplementedError(absl::StrCat("no method ", std::string(rpc))); }

// The JSON object of a query's parameters.
StatusOr<std::string> JsonOfParams(const Descriptor& type, const HeaderList& params) {
  nlohmann::json object = nlohmann::json::object();
  for (const auto& [name, value] : params) {
    const FieldDescriptor* found = nullptr;
    for (int i = 0; i < type.field_count(); ++i) {
      if (type.field(i)->json_name() == name) found = type.field(i);
    }
    if (found == nullptr || found->is_repeated() || found->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      return absl::InvalidArgumentError(absl::StrCat("query: found an unknown parameter '", name, "'"));
    }
    if (object.contains(name)) {
      return absl::InvalidArgumentError(absl::StrCat("query: found the parameter '", name, "' twice"));
    }
    const bool is_bool = found->cpp_type() == FieldDescriptor::CPPTYPE_BOOL;
    if (is_bool && value != "true" && value != "false") {
      return absl::InvalidArgumentError(absl::StrCat("query: ", name, ": found '", value, "', expected true or false"));
    }
    object[name] = is_bool ? nlohmann::json(value == "true") : nlohmann::json(value);
  }
  return object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Status Parse(const std::string& json, Message* message) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = false;
  const auto parsed = google::protobuf::util::JsonStringToMessage(json, message, options);
  if (parsed.ok()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("body: ", std::string(parsed.message())));
}

}  // namespace

StatusOr<std::string> RequestOf(std::string_view rpc, const std::string& body, const HeaderList& params,
                                std::string_view field, const std::string& value) {
  const MethodDescriptor* const method = MethodOf(rpc);
  if (method == nullptr) return NoMethod(rpc);
  const std::unique_ptr<Message> request = NewMessage(*method->input_type());
  if (!body.empty()) TESSERA_RETURN_IF_ERROR(Parse(body, request.get()));
  if (!params.empty()) {
    TESSERA_ASSIGN_OR_RETURN(const std::string json, JsonOfParams(*method->input_type(), params));
    const std::unique_ptr<Message> of_query = NewMessage(*method->input_type());
    TESSERA_RETURN_IF_ERROR(Parse(json, of_query.get()));
    request->MergeFrom(*of_query);
  }
  if (!field.empty()) {
    const FieldDescriptor* const named = method->input_type()->FindFieldByName(std::string(field));
    if (named == nullptr) return NoMethod(rpc);
    request->GetReflection()->SetString(request.get(), named, value);
  }
  return request->SerializeAsString();
}

StatusOr<std::string> JsonOf(std::string_view rpc, const std::string& answer) {
  const MethodDescriptor* const method = MethodOf(rpc);
  if (method == nullptr) return NoMethod(rpc);
  const std::unique_ptr<Message> message = NewMessage(*method->output_type());
  if (!message->ParseFromString(answer)) return absl::InternalError("malformed answer");
  return JsonOfMessage(*message);
}

}  // namespace tessera

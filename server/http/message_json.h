// The JSON of messages, as protobuf defines it.
#pragma once

#include <string>

namespace google::protobuf {
class Message;
}  // namespace google::protobuf

namespace tessera {

// Equal as a JSON value to MessageToJsonString with always_print_primitive_fields: lowerCamelCase names, enums by name,
// 64-bit integers as strings, bytes in base64, default values included. Reads the fields directly:
// protobuf's printer serializes the message and resolves its types by name, which takes seven times as long. Numbers
// have the fewest digits that identify them. Bytes of a string that are not UTF-8 become U+FFFD. Of the types of
// google.protobuf, `message` may contain only Timestamp.
std::string JsonOfMessage(const google::protobuf::Message& message);

}  // namespace tessera

// JSON of HTTP to messages of calls and back, as protobuf defines it, for any method of tessera.v1.
#pragma once

#include <string>
#include <string_view>

#include "common/base/status.h"
#include "server/web/web_message.h"

namespace tessera {

// The serialized request of a method such as "/tessera.v1.Jobs/ListTiles". `body`: JSON object, or empty. `params`:
// further fields by their names in JSON. `field`, if not empty, is set to `value`, whatever the others say.
// INVALID_ARGUMENT for a malformed body and unknown fields. `rpc` must exist.
StatusOr<std::string> RequestOf(std::string_view rpc, const std::string& body, const HeaderList& params,
                                std::string_view field, const std::string& value);

// The JSON of a serialized answer: lowerCamelCase names, enums by name, int64 as strings, default values included.
StatusOr<std::string> JsonOf(std::string_view rpc, const std::string& answer);

}  // namespace tessera

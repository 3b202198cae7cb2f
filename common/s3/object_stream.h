// Reading an object of a store in one stream that survives interruptions.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "common/base/retry/retry.h"
#include "common/base/status.h"
#include "common/s3/http_client.h"

namespace tessera {

// Sends one GET with further headers. Returns answers with status 2xx, 412 and 416, and the statuses of others.
using SendGet = std::function<StatusOr<HttpAnswer>(
    const HttpHeaders& headers, const std::function<Status(const HttpAnswer& head, std::string_view bytes)>& take)>;

// Passes the bytes from `offset_bytes` to the object's end to `take`, in order, each once. After a transient error the
// stream goes on where it stopped (Range), if the object's ETag is the same (If-Match); else ABORTED. Attempts are
// counted from the last byte that arrived. `what`: the object, for messages.
Status StreamObject(const std::string& what, const SendGet& send, int64_t offset_bytes, const RetryPolicy& policy,
                    const Sleeper& sleeper, const std::function<Status(std::string_view bytes)>& take);

// The range of an answer with status 206, or of the whole of one with status 200. INTERNAL if it does not begin at
// `offset_bytes`, or if the answer does not say its length.
struct ObjectRange {
  int64_t end_bytes = 0;    // one after the last byte of this answer
  int64_t total_bytes = 0;  // of the object
};
StatusOr<ObjectRange> RangeOf(const HttpAnswer& answer, int64_t offset_bytes);

}  // namespace tessera

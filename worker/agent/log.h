// The worker's log on standard error: one line an event, key=value, or JSON.
#ifndef TESSERA_WORKER_AGENT_LOG_H_
#define TESSERA_WORKER_AGENT_LOG_H_

#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

using LogFields = std::vector<std::pair<std::string, std::string>>;

// `level`: debug, info, warn, error or off; INVALID_ARGUMENT for another. Call once, before any thread logs.
Status SetUpLog(const std::string& level, bool json);

// Thread-safe.
void LogDebug(const std::string& event, const LogFields& fields = {});
void LogInfo(const std::string& event, const LogFields& fields = {});
void LogWarning(const std::string& event, const LogFields& fields = {});
void LogError(const std::string& event, const LogFields& fields = {});

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_LOG_H_

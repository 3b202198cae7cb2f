#include "worker/agent/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <chrono>
#include <nlohmann/json.hpp>

namespace tessera {
namespace {

std::atomic<bool> json_lines{false};

// Quoted where a reader of key=value could take it for more than one value.
std::string Quoted(const std::string& value) {
  if (!value.empty() && value.find_first_of(" \t\n\"=") == std::string::npos) return value;
  return nlohmann::json(value).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

void Log(spdlog::level::level_enum level, const std::string& event, const LogFields& fields) {
  if (!spdlog::should_log(level)) return;
  if (json_lines) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    nlohmann::ordered_json line;
    line["time_ms"] = std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
    const auto name = spdlog::level::to_string_view(level);
    line["level"] = std::string(name.data(), name.size());
    line["event"] = event;
    for (const auto& [key, value] : fields) line[key] = value;
    spdlog::log(level, "{}", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    return;
  }
  std::string line = event;
  for (const auto& [key, value] : fields) line += " " + key + "=" + Quoted(value);
  spdlog::log(level, "{}", line);
}

}  // namespace

Status SetUpLog(const std::string& level, bool json) {
  const auto parsed = spdlog::level::from_str(level);
  if (parsed == spdlog::level::off && level != "off") {
    return absl::InvalidArgumentError("--log-level: found " + level + ", expected debug, info, warn, error or off");
  }
  json_lines = json;
  auto logger = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_pattern(json ? "%v" : "%Y-%m-%dT%H:%M:%S.%e %L %v");
  logger->set_level(parsed);
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(logger);
  return absl::OkStatus();
}

void LogDebug(const std::string& event, const LogFields& fields) { Log(spdlog::level::debug, event, fields); }
void LogInfo(const std::string& event, const LogFields& fields) { Log(spdlog::level::info, event, fields); }
void LogWarning(const std::string& event, const LogFields& fields) { Log(spdlog::level::warn, event, fields); }
void LogError(const std::string& event, const LogFields& fields) { Log(spdlog::level::err, event, fields); }

}  // namespace tessera

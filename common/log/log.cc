#include "common/log/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <iterator>
#include <memory>

#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr size_t kMaxValueBytes = 16 << 10;

std::atomic<bool> json_lines{false};

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  return static_cast<spdlog::level::level_enum>(spdlog::level::debug + static_cast<int>(level));
}

std::string Shortened(const std::string& value) {
  if (value.size() <= kMaxValueBytes) return value;
  const std::string_view kept = Prefix(value, kMaxValueBytes);
  return std::string(kept) + "... and " + std::to_string(value.size() - kept.size()) + " more bytes";
}

// Quotes values with spaces, quotes, '=' or unprintable characters, so that a parser reads one value.
std::string TextValue(const std::string& value) {
  const bool plain = !value.empty() && value.find_first_of(" \"=\\") == std::string::npos && Printable(value) == value;
  return plain ? value : JsonQuoted(value);
}

}  // namespace

Status SetUpLog(const std::string& level, bool json) {
  const auto parsed = spdlog::level::from_str(level);
  static const char* const kLevels[] = {"debug", "info", "warn", "error", "off"};
  if (std::find(std::begin(kLevels), std::end(kLevels), level) == std::end(kLevels)) {
    return absl::InvalidArgumentError("--log-level: found '" + level + "', expected debug, info, warn, error or off");
  }
  auto logger = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_level(parsed);
  logger->flush_on(spdlog::level::info);
  const std::string time = "%Y-%m-%dT%H:%M:%S.%eZ";
  logger->set_pattern(json ? R"({"time":")" + time + R"(","level":"%l",%v})" : time + " %l %v",
                      spdlog::pattern_time_type::utc);
  spdlog::set_default_logger(std::move(logger));
  json_lines = json;
  return absl::OkStatus();
}

std::string LogLine(const std::string& message, const LogFields& fields, bool json) {
  std::string line;
  if (json) {
    line.append("\"message\":").append(JsonQuoted(Shortened(message)));
    for (const auto& [key, value] : fields) {
      line.append(",").append(JsonQuoted(key)).append(":").append(JsonQuoted(Shortened(value)));
    }
  } else {
    line = Printable(Shortened(message));
    for (const auto& [key, value] : fields) {
      line.append(" ").append(key).append("=").append(TextValue(Shortened(value)));
    }
  }
  return line;
}

void LogEvent(LogLevel level, const std::string& message, const LogFields& fields) {
  spdlog::logger* const logger = spdlog::default_logger_raw();
  if (!logger->should_log(ToSpdlog(level))) return;
  logger->log(ToSpdlog(level), "{}", LogLine(message, fields, json_lines));
}

}  // namespace tessera

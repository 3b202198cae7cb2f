#include "server/api/logging.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "server/dispatch/worker_evidence.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

std::atomic<bool> json_lines{false};

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      return spdlog::level::err;
  }
  return spdlog::level::err;
}

// Quoted where a reader would otherwise take it for more than one value.
std::string Value(const std::string& text) {
  if (!text.empty() && text.find_first_of(" \t\n\"=") == std::string::npos) return text;
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

Status ConfigureLogging(const std::string& level, bool json) {
  static const std::map<std::string, spdlog::level::level_enum> kLevels = {{"debug", spdlog::level::debug},
                                                                           {"info", spdlog::level::info},
                                                                           {"warn", spdlog::level::warn},
                                                                           {"error", spdlog::level::err},
                                                                           {"off", spdlog::level::off}};
  const auto it = kLevels.find(level);
  if (it == kLevels.end()) {
    return absl::InvalidArgumentError("log level '" + level + "': expected debug, info, warn, error or off");
  }
  auto logger = std::make_shared<spdlog::logger>("tesserad", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_level(it->second);
  logger->flush_on(spdlog::level::info);
  // The JSON line is put together in LogEvent; the pattern adds nothing but time and level.
  logger->set_pattern(json ? R"({"time":"%Y-%m-%dT%H:%M:%S.%e%z","level":"%l",%v})" : "%Y-%m-%dT%H:%M:%S.%e%z %l %v");
  spdlog::set_default_logger(std::move(logger));
  json_lines = json;
  return absl::OkStatus();
}

void LogEvent(LogLevel level, const std::string& message,
              const std::vector<std::pair<std::string, std::string>>& fields) {
  std::string line;
  if (json_lines) {
    nlohmann::ordered_json json = {{"message", message}};
    for (const auto& [key, value] : fields) json[key] = value;
    line = json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    line = line.substr(1, line.size() - 2);
  } else {
    line = message;
    for (const auto& [key, value] : fields) line += " " + key + "=" + Value(value);
  }
  spdlog::default_logger_raw()->log(ToSpdlog(level), "{}", line);
}

void LogRecord(const v1::Record& record) {
  switch (record.change_case()) {
    case v1::Record::kJobAccepted: {
      const auto& change = record.job_accepted();
      return LogEvent(LogLevel::kInfo, "job accepted",
                      {{"job", change.job()},
                       {"scene", change.scene_path()},
                       {"files", std::to_string(change.scene_files_size())}});
    }
    case v1::Record::kTasksPlanned:
      return LogEvent(
          LogLevel::kInfo, "tasks planned",
          {{"job", record.tasks_planned().job()}, {"tasks", std::to_string(record.tasks_planned().tasks_size())}});
    case v1::Record::kAttemptStarted: {
      const auto& change = record.attempt_started();
      return LogEvent(
          LogLevel::kInfo, "task leased",
          {{"task", change.task()}, {"attempt", std::to_string(change.attempt())}, {"worker", change.worker()}});
    }
    case v1::Record::kTaskSucceeded: {
      const auto& change = record.task_succeeded();
      return LogEvent(LogLevel::kInfo, change.reused() ? "task reused" : "task succeeded",
                      {{"task", change.task()}, {"attempt", std::to_string(change.attempt())}});
    }
    case v1::Record::kAttemptFailed: {
      const auto& change = record.attempt_failed();
      return LogEvent(change.final() ? LogLevel::kError : LogLevel::kWarning,
                      change.final() ? "task failed" : "attempt failed",
                      {{"task", change.task()},
                       {"attempt", std::to_string(change.attempt())},
                       {"class", v1::ErrorClass_Name(change.error().error_class())},
                       {"error", change.error().message()}});
    }
    case v1::Record::kJobEnded: {
      const auto& change = record.job_ended();
      return LogEvent(change.state() == v1::JOB_FAILED ? LogLevel::kError : LogLevel::kInfo, "job ended",
                      {{"job", change.job()}, {"state", v1::JobState_Name(change.state())}, {"error", change.error()}});
    }
    case v1::Record::kJobChanged: {
      const auto& change = record.job_changed();
      std::vector<std::pair<std::string, std::string>> fields = {{"job", change.job()}};
      if (change.has_priority()) fields.emplace_back("priority", std::to_string(change.priority()));
      if (change.has_paused()) fields.emplace_back("paused", change.paused() ? "yes" : "no");
      return LogEvent(LogLevel::kInfo, "job changed", fields);
    }
    case v1::Record::kTileSetAside: {
      const auto& change = record.tile_set_aside();
      return LogEvent(
          LogLevel::kWarning, "tile set aside",
          {{"job", change.job()}, {"tile", std::to_string(change.tile())}, {"task", std::to_string(change.task())}});
    }
    case v1::Record::kJobRetried: {
      const auto& change = record.job_retried();
      return LogEvent(LogLevel::kInfo, "job retried",
                      {{"job", change.job()}, {"tile", change.has_tile() ? std::to_string(change.tile()) : "all"}});
    }
    case v1::Record::kResultLost: {
      const auto& change = record.result_lost();
      return LogEvent(LogLevel::kWarning, "result lost, made again",
                      {{"task", change.task()}, {"reason", change.reason()}});
    }
    case v1::Record::kJobDeleted:
      return LogEvent(LogLevel::kInfo, "job deleted",
                      {{"job", record.job_deleted().job()}, {"reason", record.job_deleted().reason()}});
    case v1::Record::kJobBegunAnew:
      return LogEvent(
          LogLevel::kWarning, "job of another version begins anew",
          {{"job", record.job_begun_anew().job()}, {"algorithm_version", record.job_begun_anew().algorithm_version()}});
    case v1::Record::CHANGE_NOT_SET:
      return;
  }
}

void LogWorkerSetAside(const SetAsideWorker& worker) {
  LogEvent(
      LogLevel::kWarning, "worker set aside",
      {{"worker", worker.worker}, {"seconds", std::to_string(std::lround(worker.for_s))}, {"reason", worker.reason}});
}

void LogSetAside(int64_t number, const std::string& reason) {
  LogEvent(LogLevel::kError, "stored record set aside", {{"record", std::to_string(number)}, {"reason", reason}});
}

void LogStorageTrouble(const Status& trouble) {
  if (trouble.ok()) return LogEvent(LogLevel::kInfo, "records are stored again");
  LogEvent(LogLevel::kError, "records cannot be stored: all waits, and goes on when they can",
           {{"reason", std::string(trouble.message())}});
}

}  // namespace tessera

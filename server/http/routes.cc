#include "server/http/routes.h"

#include <algorithm>
#include <optional>

#include "server/web/web_message.h"

namespace tessera {
namespace {

constexpr std::string_view kJob = "{job}", kName = "{name}";
constexpr size_t kMaxDigits = 9;

// Sets what the pattern's names stand for.
bool Matches(std::string_view pattern, std::string_view path, RouteMatch* match) {
  while (!pattern.empty()) {
    if (pattern.starts_with(kName)) {
      match->name = path;
      return !path.empty();
    }
    if (pattern.starts_with(kJob)) {
      const size_t digits = std::min(path.find_first_not_of("0123456789"), path.size());
      if (digits == 0 || digits > kMaxDigits || path.front() == '0') return false;
      match->job = "jobs/" + std::string(path.substr(0, digits));
      path.remove_prefix(digits);
      pattern.remove_prefix(kJob.size());
      continue;
    }
    if (path.empty() || path.front() != pattern.front()) return false;
    path.remove_prefix(1);
    pattern.remove_prefix(1);
  }
  return path.empty();
}

}  // namespace

const std::vector<Route>& Routes() {
  using enum RouteKind;
  static const std::vector<Route> kRoutes = {
      {"POST", "/api/v1/session", "", kBeginSession},
      {"GET", "/api/v1/session", "", kReadSession},
      {"DELETE", "/api/v1/session", "", kEndSession},
      {"GET", "/api/v1/jobs", "/tessera.v1.Jobs/ListJobs", kCall, "", Lane::kQuick, true},
      {"POST", "/api/v1/jobs", "/tessera.v1.Jobs/CreateJob", kCall, "", Lane::kSlow},
      {"GET", "/api/v1/jobs/{job}", "/tessera.v1.Jobs/GetJob", kCall, "name", Lane::kQuick, true},
      {"PATCH", "/api/v1/jobs/{job}", "/tessera.v1.Jobs/ChangeJob", kCall, "name"},
      {"DELETE", "/api/v1/jobs/{job}", "/tessera.v1.Jobs/DeleteJob", kCall, "name"},
      {"POST", "/api/v1/jobs/{job}:cancel", "/tessera.v1.Jobs/CancelJob", kCall, "name"},
      {"POST", "/api/v1/jobs/{job}:retry", "/tessera.v1.Jobs/RetryJob", kCall, "name"},
      {"POST", "/api/v1/jobs/{job}:export", "/tessera.v1.Jobs/ExportJob", kCall, "name", Lane::kSlow},
      {"GET", "/api/v1/jobs/{job}:state", "/tessera.v1.Jobs/WatchJob", kState, "name", Lane::kQuick, true},
      {"GET", "/api/v1/jobs/{job}:watch", "/tessera.v1.Jobs/WatchJob", kWatch, "name", Lane::kStream},
      {"GET", "/api/v1/jobs/{job}/tasks", "/tessera.v1.Jobs/ListTasks", kCall, "parent", Lane::kQuick, true},
      {"GET", "/api/v1/jobs/{job}/attempts", "/tessera.v1.Jobs/ListAttempts", kCall, "parent", Lane::kQuick, true},
      {"GET", "/api/v1/jobs/{job}/tiles", "/tessera.v1.Jobs/ListTiles", kCall, "parent", Lane::kQuick, true},
      {"GET", "/api/v1/jobs/{job}/views", "/tessera.v1.Jobs/ListViews", kCall, "parent", Lane::kQuick, true},
      {"GET", "/api/v1/jobs/{job}:locate", "/tessera.v1.Jobs/LocatePoint", kCall, "name"},
      {"GET", "/api/v1/jobs/{job}/artifacts", "/tessera.v1.Jobs/ListArtifacts", kCall, "parent", Lane::kQuick, true},
      {"GET", "/api/v1/workers", "/tessera.v1.Workers/ListWorkers", kCall, "", Lane::kQuick, true},
      {"GET", "/api/v1/settings", "/tessera.v1.Jobs/ListSettings", kCall, "", Lane::kQuick, true},
      {"POST", "/api/v1/quote", "/tessera.v1.Jobs/QuoteJob", kCall, "", Lane::kSlow},
      // The content is read by ReadBlob, which has a check of its own.
      {"GET", "/files/jobs/{job}/{name}", "/tessera.v1.Jobs/GetJob", kFile, "name", Lane::kFile},
      {"GET", "/", "", kPage},
      {"GET", "/assets/{name}", "", kPage},
  };
  return kRoutes;
}

RouteMatch FindRoute(std::string_view method, std::string_view path) {
  if (method == "HEAD") method = "GET";
  RouteMatch other;
  for (const Route& route : Routes()) {
    RouteMatch match;
    if (!Matches(route.path, path, &match)) continue;
    if (route.method == method) {
      match.route = &route;
      return match;
    }
    other.other_method = true;
  }
  return other;
}

std::vector<std::string> HttpRouteNames() {
  std::vector<std::string> names;
  for (const Route& route : Routes()) names.push_back(std::string(route.method) + " " + std::string(route.path));
  return names;
}

size_t RouteIndex(std::string_view method, std::string_view raw_path) {
  const auto path = DecodedPath(raw_path);
  const RouteMatch match = path.ok() ? FindRoute(method, *path) : RouteMatch();
  return match.route == nullptr ? Routes().size() : static_cast<size_t>(match.route - Routes().data());
}

}  // namespace tessera

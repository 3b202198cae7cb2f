// The table of all paths that the coordinator serves over HTTP.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/web/lanes.h"

namespace tessera {

enum class RouteKind {
  kCall,          // a call with one answer
  kState,         // the first message of a watch
  kWatch,         // a watch as server-sent events
  kBeginSession,  // log in
  kReadSession,   // who is logged in
  kEndSession,    // log out
  kFile,          // a published file
  kPage,          // the page and its assets
};

struct Route {
  std::string_view method;  // GET rows answer HEAD, too
  // {job}: the number of a job; {name}: the rest of the path, also with slashes.
  std::string_view path;
  // The method that access is decided by, and that is called; empty: none.
  std::string_view rpc;
  RouteKind kind = RouteKind::kCall;
  std::string_view job_field = {};  // the request's field that names the job
  Lane lane = Lane::kQuick;
  bool polled = false;  // many pages ask again and again: they share answers
};

const std::vector<Route>& Routes();

struct RouteMatch {
  const Route* route = nullptr;  // null: none
  bool other_method = false;     // the path has a route with another method
  std::string job;               // "jobs/N"
  std::string name;              // the rest
};

// `path`: decoded, without the query.
RouteMatch FindRoute(std::string_view method, std::string_view path);

// For HttpCounts, in the order of Routes(): "GET /api/v1/jobs/{job}".
std::vector<std::string> HttpRouteNames();
// The index in it of a request; the number of routes if it has none.
size_t RouteIndex(std::string_view method, std::string_view raw_path);

}  // namespace tessera

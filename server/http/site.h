// What the coordinator serves over HTTP: sessions, the API, files of jobs and the page.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "server/auth/access.h"
#include "server/grpc/job_watches.h"
#include "server/grpc/local_calls.h"
#include "server/http/job_files.h"
#include "server/http/routes.h"
#include "server/http/shared_answers.h"
#include "server/http/visitors.h"
#include "server/metrics/http_counts.h"
#include "server/web/connections.h"
#include "server/web/request_frame.h"
#include "server/web/web_message.h"

namespace tessera {

struct SiteEnvironment {
  LocalCalls* calls = nullptr;
  JobWatches* watches = nullptr;
  const Access* access = nullptr;
  std::string version;  // of the program
  bool tls = false;
  bool insecure = false;                    // as ListenOptions
  std::function<void()> before_reply = {};  // as ServerEnvironment
  HttpCounts* counts = nullptr;             // by HttpRouteNames(); null: none
};

// Thread-safe.
class Site {
 public:
  // What `environment` refers to must outlive this.
  explicit Site(const SiteEnvironment& environment);

  static Lane LaneOf(const RequestFrame& request);
  // As RequestHandler.
  std::string OwnerOf(Lane lane, const ReceivedRequest& request);
  WebAnswer Answer(const WebRequest& request);

  // Whether AnswerAtOnce could answer the request. Quick.
  static bool MayAnswerAtOnce(const RequestFrame& request);
  // The answer if it needs neither a call nor much time: what many pages poll. Else nullopt.
  std::optional<WebAnswer> AnswerAtOnce(const WebRequest& request);
  // An answer of this site to a request that is not read.
  WebAnswer Refusal(int status) const;

 private:
  // `at_once`: nullopt for what cannot be answered at once.
  std::optional<WebAnswer> Route(const WebRequest& request, bool at_once);
  std::optional<WebAnswer> Finished(const WebRequest& request, std::optional<WebAnswer> answer) const;
  WebAnswer Dispatch(const WebRequest& request, const RouteMatch& match, const Visitor& visitor);
  // The request's message; INVALID_ARGUMENT if it is malformed.
  static StatusOr<std::string> MessageOf(const WebRequest& request, const RouteMatch& match);
  WebAnswer BeginSession(const WebRequest& request);
  WebAnswer SessionOf(const Visitor& visitor) const;
  WebAnswer Call(const WebRequest& request, const RouteMatch& match, const Visitor& visitor);
  WebAnswer State(const WebRequest& request, const RouteMatch& match);
  WebAnswer Watch(const WebRequest& request, const RouteMatch& match, const Visitor& visitor);
  // The JSON of a state, and its event in a stream. All who get the state share them.
  StatusOr<SharedAnswers::Answer> StateOf(const JobUpdate& update);
  StatusOr<SharedAnswers::Answer> EventOf(const JobUpdate& update);
  static void AddHeaders(const WebRequest& request, WebAnswer* answer);

  const SiteEnvironment environment_;
  Visitors visitors_;
  SharedAnswers shared_;
  JobFiles files_;
};

}  // namespace tessera

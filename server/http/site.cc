#include "server/http/site.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/log/log.h"
#include "server/http/gzip.h"
#include "server/http/message_json.h"
#include "server/http/page_answers.h"
#include "server/http/transcoding.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

using Steady = std::chrono::steady_clock;

constexpr double kCall_s = 30, kSlowCall_s = 600;
constexpr double kTick_s = 1;  // between two checks of a stream's visitor and connection
constexpr double kPing_s = 15, kBetweenEvents_s = 0.5;
constexpr int kMaxRunning = 100;               // tasks of a state
constexpr size_t kMostAtOnceBytes = 32 << 10;  // of an answer that the receiving thread sends
constexpr size_t kMaxTokenBytes = 4 << 10, kLeastGzipBytes = 1 << 10;

constexpr char kPolicy[] =
    "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'; worker-src 'self' blob:; style-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'";

std::string SessionCookie(const std::string& id, bool tls) {
  return absl::StrCat("tessera_session=", id, "; HttpOnly; SameSite=Strict; Path=/", tls ? "; Secure" : "",
                      id.empty() ? "; Max-Age=0" : "");
}

Status NoSession() { return absl::UnauthenticatedError("unauthenticated: log in with a token"); }

WebAnswer NotFound() { return ErrorAnswer(404, "NOT_FOUND", "no such path"); }

std::string QuotedEtag(const std::string& etag) { return absl::StrCat("\"", etag, "\""); }

bool AcceptsGzip(const WebRequest& request) {
  const std::string accepted = request.Header("Accept-Encoding").value_or("");
  return absl::StrContains(accepted, "gzip") && !absl::StrContains(accepted, "gzip;q=0");
}

// What identifies a shared answer to a request.
std::string SharedKey(const WebRequest& request, const RouteMatch& match) {
  const std::string_view target = request.target;
  return absl::StrCat(std::string(match.route->rpc), " ", match.job, " ",
                      std::string(target.substr(std::min(request.RawPath().size(), target.size()))), "\n",
                      request.body);
}

bool HasAnswer(const WebRequest& request, const SharedAnswer& shared) {
  return HasEtag(request.Header("If-None-Match").value_or(""), shared.etag());
}

// A shared answer for one visitor: 304 if the visitor has it.
WebAnswer AnswerWith(const WebRequest& request, const SharedAnswer& shared) {
  WebAnswer answer = JsonAnswer("");
  answer.headers.emplace_back("ETag", QuotedEtag(shared.etag()));
  if (HasAnswer(request, shared)) {
    answer.status = 304;
    answer.type.clear();
    return answer;
  }
  const bool packed = AcceptsGzip(request) && !shared.gzip().empty();
  if (packed) answer.headers.emplace_back("Content-Encoding", "gzip");
  answer.body = packed ? shared.gzip() : shared.json();
  return answer;
}

std::string EndEvent(const Status& status) {
  if (status.ok()) return "event: end\ndata: {}\n\n";
  return absl::StrCat("event: error\ndata: ", ErrorAnswer(status).body, "\n\n");
}

}  // namespace

Site::Site(const SiteEnvironment& environment)
    : environment_(environment), visitors_(environment.access, environment.insecure), files_(environment.calls) {}

Lane Site::LaneOf(const RequestFrame& request) {
  const std::string_view target = request.target;
  const auto path = DecodedPath(target.substr(0, target.find('?')));
  if (!path.ok()) return Lane::kQuick;
  const RouteMatch match = FindRoute(request.method, *path);
  return match.route == nullptr ? Lane::kQuick : match.route->lane;
}

std::string Site::OwnerOf(Lane lane, const ReceivedRequest& received) {
  if (lane != Lane::kSlow && lane != Lane::kFile) return "";
  WebRequest request;
  request.peer = received.peer;
  for (const absl::string_view line : absl::StrSplit(received.frame.head, "\r\n")) {
    const std::pair<std::string, std::string> header = absl::StrSplit(line, absl::MaxSplits(':', 1));
    request.headers.emplace_back(header.first, absl::StripAsciiWhitespace(header.second));
  }
  return visitors_.ClientOf(request);
}

bool Site::MayAnswerAtOnce(const RequestFrame& request) {
  const std::string_view target = request.target;
  const auto path = DecodedPath(target.substr(0, target.find('?')));
  if (!path.ok()) return false;
  const RouteMatch match = FindRoute(request.method, *path);
  return match.route != nullptr && match.route->polled;
}

WebAnswer Site::Answer(const WebRequest& request) { return *Finished(request, Route(request, false)); }

std::optional<WebAnswer> Site::AnswerAtOnce(const WebRequest& request) {
  return Finished(request, Route(request, true));
}

std::optional<WebAnswer> Site::Finished(const WebRequest& request, std::optional<WebAnswer> answer) const {
  if (!answer) return answer;
  AddHeaders(request, &*answer);
  if (environment_.before_reply) environment_.before_reply();
  if (environment_.counts != nullptr) {
    const double seconds = std::chrono::duration<double>(Steady::now() - request.arrived).count();
    environment_.counts->Count(RouteIndex(request.method, request.RawPath()), answer->status, seconds);
  }
  return answer;
}

WebAnswer Site::Refusal(int status) const {
  WebAnswer answer = status == 503   ? ErrorAnswer(503, "UNAVAILABLE", "too many requests at once; try again later")
                     : status == 413 ? ErrorAnswer(413, "INVALID_ARGUMENT", "the body is too large")
                                     : ErrorAnswer(status, "INVALID_ARGUMENT", "malformed request");
  if (status == 503) {
    for (auto& [name, value] : answer.headers) value = name == "Retry-After" ? "5" : value;
  }
  AddHeaders({}, &answer);
  if (environment_.counts != nullptr) environment_.counts->Count(Routes().size(), status, 0);
  return answer;
}

void Site::AddHeaders(const WebRequest& request, WebAnswer* answer) {
  const auto has = [&](const char* name) {
    return std::any_of(answer->headers.begin(), answer->headers.end(),
                       [&](const auto& header) { return header.first == name; });
  };
  if (!has("Content-Security-Policy")) answer->headers.emplace_back("Content-Security-Policy", kPolicy);
  if (!has("Cache-Control")) answer->headers.emplace_back("Cache-Control", "no-store");
  answer->headers.emplace_back("X-Content-Type-Options", "nosniff");
  answer->headers.emplace_back("Referrer-Policy", "no-referrer");
  answer->headers.emplace_back("Cross-Origin-Resource-Policy", "same-origin");
  answer->headers.emplace_back("Cross-Origin-Opener-Policy", "same-origin");
  if (!answer->produce && answer->body.size() >= kLeastGzipBytes && !has("Content-Encoding") &&
      absl::StartsWith(answer->type, "application/json") && AcceptsGzip(request)) {
    if (std::string packed = Gzip(answer->body); !packed.empty()) {
      answer->body = std::move(packed);
      answer->headers.emplace_back("Content-Encoding", "gzip");
    }
  }
}

std::optional<WebAnswer> Site::Route(const WebRequest& request, bool at_once) {
  const auto path = DecodedPath(request.RawPath());
  if (!path.ok()) return NotFound();
  const RouteMatch match = FindRoute(request.method, *path);
  if (match.route == nullptr) {
    return match.other_method ? ErrorAnswer(405, "UNIMPLEMENTED", "no such method for this path") : NotFound();
  }
  if (const Status own = visitors_.CheckOrigin(request); !own.ok()) return ErrorAnswer(own);
  if (match.route->kind == RouteKind::kPage) return PageAnswer(request, match.name);
  if (match.route->kind == RouteKind::kBeginSession) return BeginSession(request);
  const auto visitor = visitors_.Identify(request);
  if (!visitor.ok()) return ErrorAnswer(visitor.status());
  if (match.route->kind == RouteKind::kEndSession) {
    visitors_.End(*visitor);
    WebAnswer answer = JsonAnswer("{}");
    answer.headers.emplace_back("Set-Cookie", SessionCookie("", request.tls));
    return answer;
  }
  if (visitor->identity.roles == 0 && !visitor->caller.authorization) return ErrorAnswer(NoSession());
  if (match.route->kind == RouteKind::kReadSession) {
    return visitor->identity.roles == 0 ? ErrorAnswer(NoSession()) : SessionOf(*visitor);
  }
  const Status admitted = environment_.calls->Admit(std::string(match.route->rpc), visitor->caller);
  if (!admitted.ok()) return ErrorAnswer(admitted);
  if (!at_once) return Dispatch(request, match, *visitor);
  const SharedAnswers::Answer shared = shared_.Find(SharedKey(request, match));
  if (shared == nullptr) return std::nullopt;
  const size_t bytes = AcceptsGzip(request) ? shared->packed_bytes() : shared->json().size();
  if (bytes > kMostAtOnceBytes && !HasAnswer(request, *shared)) return std::nullopt;
  return AnswerWith(request, *shared);
}

WebAnswer Site::Dispatch(const WebRequest& request, const RouteMatch& match, const Visitor& visitor) {
  switch (match.route->kind) {
    case RouteKind::kState:
      return State(request, match);
    case RouteKind::kWatch:
      return Watch(request, match, visitor);
    case RouteKind::kFile:
      return files_.Answer(request, visitor.caller, match.job, match.name);
    default:
      return Call(request, match, visitor);
  }
}

StatusOr<std::string> Site::MessageOf(const WebRequest& request, const RouteMatch& match) {
  if (match.route->kind == RouteKind::kState && !request.params.empty()) {
    return absl::InvalidArgumentError("query: expected no parameters");
  }
  return RequestOf(match.route->rpc, request.body, request.params, match.route->job_field, match.job);
}

WebAnswer Site::BeginSession(const WebRequest& request) {
  const nlohmann::json body = nlohmann::json::parse(request.body, nullptr, false);
  const bool good = body.is_object() && body.contains("token") && body["token"].is_string();
  const std::string token =
      good ? std::string(absl::StripAsciiWhitespace(body["token"].get_ref<const std::string&>())) : "";
  if (!good || token.size() > kMaxTokenBytes) {
    return ErrorAnswer(absl::InvalidArgumentError("body: expected {\"token\": \"...\"}"));
  }
  const auto visitor = visitors_.Begin(request, token);
  if (!visitor.ok()) return ErrorAnswer(visitor.status());
  WebAnswer answer = SessionOf(*visitor);
  if (!visitor->session.empty()) {
    answer.headers.emplace_back("Set-Cookie", SessionCookie(visitor->session, request.tls));
  }
  return answer;
}

WebAnswer Site::SessionOf(const Visitor& visitor) const {
  std::set<std::string> may;
  for (const tessera::Route& route : Routes()) {
    const auto roles = RolesFor(std::string(route.rpc));
    if (roles && (visitor.identity.roles & *roles) != 0) may.emplace(route.rpc);
  }
  std::string role = "admin";
  for (const Role each : {Role::kViewer, Role::kSubmitter, Role::kWorker}) {
    if (visitor.identity.roles == static_cast<unsigned>(each)) role = NameOf(each);
  }
  const nlohmann::json session = {
      {"name", visitor.identity.name},   {"role", role}, {"tokensRequired", environment_.access->asks_for_tokens()},
      {"version", environment_.version}, {"may", may},   {"httpsOnly", environment_.tls}};
  return JsonAnswer(session.dump());
}

WebAnswer Site::Call(const WebRequest& request, const RouteMatch& match, const Visitor& visitor) {
  const std::string rpc(match.route->rpc);
  const auto message = MessageOf(request, match);
  if (!message.ok()) return ErrorAnswer(message.status());
  const auto call = [&]() -> StatusOr<std::string> {
    TESSERA_ASSIGN_OR_RETURN(const std::string answer,
                             environment_.calls->Call(rpc, visitor.caller, *message,
                                                      match.route->lane == Lane::kSlow ? kSlowCall_s : kCall_s));
    return JsonOf(rpc, answer);
  };
  if (!match.route->polled) {
    auto json = call();
    return json.ok() ? JsonAnswer(*std::move(json)) : ErrorAnswer(json.status());
  }
  const auto shared = shared_.Get(SharedKey(request, match), [&]() -> StatusOr<SharedAnswers::Answer> {
    TESSERA_ASSIGN_OR_RETURN(std::string json, call());
    return std::make_shared<const SharedAnswer>(std::move(json), "");
  });
  return shared.ok() ? AnswerWith(request, **shared) : ErrorAnswer(shared.status());
}

StatusOr<SharedAnswers::Answer> Site::StateOf(const JobUpdate& update) {
  return shared_.Get(absl::StrCat("state ", update.number), [&]() -> StatusOr<SharedAnswers::Answer> {
    v1::WatchJobResponse state;
    if (!state.ParseFromString(update.message)) return absl::InternalError("malformed message");
    if (state.running_size() > kMaxRunning) {
      state.mutable_running()->DeleteSubrange(kMaxRunning, state.running_size() - kMaxRunning);
    }
    // Half of what a compressed state would have, and of no use to those who follow it.
    for (v1::Task& task : *state.mutable_running()) task.clear_key();
    return std::make_shared<const SharedAnswer>(JsonOfMessage(state), update.etag);
  });
}

StatusOr<SharedAnswers::Answer> Site::EventOf(const JobUpdate& update) {
  return shared_.Get(absl::StrCat("event ", update.number), [&]() -> StatusOr<SharedAnswers::Answer> {
    TESSERA_ASSIGN_OR_RETURN(const auto state, StateOf(update));
    return std::make_shared<const SharedAnswer>(absl::StrCat("id: ", update.etag, "\ndata: ", state->json(), "\n\n"),
                                                update.etag);
  });
}

WebAnswer Site::State(const WebRequest& request, const RouteMatch& match) {
  if (const auto message = MessageOf(request, match); !message.ok()) return ErrorAnswer(message.status());
  const auto shared = shared_.Get(SharedKey(request, match), [&]() -> StatusOr<SharedAnswers::Answer> {
    TESSERA_ASSIGN_OR_RETURN(const auto update, environment_.watches->Newest(match.job));
    return StateOf(*update);
  });
  return shared.ok() ? AnswerWith(request, **shared) : ErrorAnswer(shared.status());
}

WebAnswer Site::Watch(const WebRequest& request, const RouteMatch& match, const Visitor& visitor) {
  HeaderList params = request.params;
  // A browser that connects again names the last event that it has seen.
  if (const auto last = request.Header("Last-Event-ID")) params = {{"seenEtag", *last}};
  const auto message = RequestOf(match.route->rpc, "", params, match.route->job_field, match.job);
  if (!message.ok()) return ErrorAnswer(message.status());
  v1::WatchJobRequest parsed;
  parsed.ParseFromString(*message);
  auto opened = environment_.watches->Open(visitor.identity.client, parsed.name(), parsed.seen_etag());
  if (!opened.ok()) return ErrorAnswer(opened.status());
  const std::shared_ptr<JobWatches::Local> watch = *std::move(opened);
  WebAnswer answer;
  answer.type = "text/event-stream";
  if (request.method == "HEAD") return answer;
  const bool packs = AcceptsGzip(request);
  if (packs) answer.headers.emplace_back("Content-Encoding", "gzip");
  answer.produce = [this, watch, visitor, packs](const AnswerSink& sink) {
    GzipStream packed;
    const auto write = [&](const std::string& text) {
      if (environment_.before_reply) environment_.before_reply();
      return sink.write(packs ? packed.Add(GzipPart(text)) : text);
    };
    const auto end = [&](const Status& status) {
      return write(EndEvent(status)) && (!packs || sink.write(packed.End()));
    };
    if (!write("retry: 2000\n\n")) return false;
    Steady::time_point written = Steady::now();
    while (true) {
      using Event = JobWatches::Local::Event;
      std::shared_ptr<const JobUpdate> update;
      const Event event = watch->Read(kTick_s, &update);
      if (!sink.connected()) return false;
      if (!visitors_.StillHere(visitor)) return end(NoSession());
      if (event == Event::kEnd) return end(watch->status());
      if (event == Event::kUpdate) {
        const auto shared = EventOf(*update);
        if (!shared.ok()) return false;
        if (environment_.before_reply) environment_.before_reply();
        if (!sink.write(packs ? packed.Add((*shared)->part()) : (*shared)->json())) return false;
        std::this_thread::sleep_for(std::chrono::duration<double>(kBetweenEvents_s));  // states until then are skipped
      } else if (Steady::now() - written > std::chrono::duration<double>(kPing_s)) {
        if (!write(": ping\n\n")) return false;
      } else {
        continue;
      }
      written = Steady::now();
    }
  };
  return answer;
}

}  // namespace tessera

#include "server/web/connections.h"

#include <poll.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <set>
#include <thread>
#include <unordered_map>
#include <utility>

#include "common/log/log.h"
#include "server/web/lanes.h"
#include "server/web/listener.h"
#include "server/web/socket.h"

namespace tessera {
namespace {

using Steady = std::chrono::steady_clock;

constexpr int kEvents = 256;
constexpr int kSweep_ms = 250;   // between two checks of deadlines
constexpr double kLinger_s = 2;  // to receive what is not read any more, so that the other end gets the answer
constexpr size_t kLingerBytes = 4 << 20;
constexpr double kBetweenWarnings_s = 60;
constexpr int kAcceptsAtOnce = 64;
constexpr int kAnswersAtOnce = 8;  // that the receiving thread gives to one connection before it turns to others

Steady::time_point In(double seconds) {
  return Steady::now() + std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(seconds));
}

enum class ConnectionState { kHandshake, kReceiving, kAnswering, kSending, kLingering };

struct Connection {
  Connection(int fd, std::shared_ptr<ssl_ctx_st> tls) : socket(fd, std::move(tls)) {}
  Socket socket;
  std::string key, peer;  // of the other end
  ConnectionState state = ConnectionState::kHandshake;
  std::string received, answer;
  size_t awaited = 0;  // of `received`: less is no complete request, whose head is then read once
  size_t sent = 0, lingered = 0;
  bool ends = false;       // after the answer
  bool broken = false;     // the answer is not complete
  bool continued = false;  // 100 Continue was sent for the request under way
  Steady::time_point deadline, idle_since;
};

// Counts the bytes of buffered answers.
class Buffered {
 public:
  explicit Buffered(size_t limit) : limit_(limit) {}
  bool Add(size_t bytes) {
    if (bytes_.fetch_add(bytes) + bytes <= limit_) return true;
    bytes_ -= bytes;
    return false;
  }
  void Remove(size_t bytes) { bytes_ -= bytes; }

 private:
  const size_t limit_;
  std::atomic<size_t> bytes_ = 0;
};

class BufferedOutput final : public AnswerOutput {
 public:
  BufferedOutput(Connection& connection, Buffered& buffered) : connection_(connection), buffered_(buffered) {}
  bool Write(std::string_view bytes) override {
    if (!buffered_.Add(bytes.size())) {
      connection_.broken = true;
      return false;
    }
    connection_.answer.append(bytes);
    return true;
  }
  bool Connected() override { return !connection_.socket.ClosedByPeer(); }

 private:
  Connection& connection_;
  Buffered& buffered_;
};

// Writes at the pace of the reader, within limits.
class PacedOutput final : public AnswerOutput {
 public:
  PacedOutput(Connection& connection, double stall_s, const std::atomic<bool>& stops)
      : connection_(connection), stall_s_(stall_s), stops_(stops) {}
  bool Write(std::string_view bytes) override {
    if (!connection_.broken && !WriteAll(bytes)) connection_.broken = true;
    return !connection_.broken;
  }
  bool Connected() override { return !stops_ && !connection_.broken && !connection_.socket.ClosedByPeer(); }

 private:
  bool WriteAll(std::string_view bytes) {
    Steady::time_point until = In(stall_s_);
    size_t left_at_start = bytes.size();
    while (!stops_) {
      const Socket::Result result = connection_.socket.Write(&bytes);
      if (result == Socket::Result::kDone) return true;
      if (result == Socket::Result::kClosed) return false;
      if (Steady::now() > until) {
        if (left_at_start - bytes.size() < kLeastBytes) return false;
        left_at_start = bytes.size();
        until = In(stall_s_);
      }
      pollfd state = {connection_.socket.fd(),
                      static_cast<short>(result == Socket::Result::kWantsRead ? POLLIN : POLLOUT), 0};
      ::poll(&state, 1, kSweep_ms);
    }
    return false;
  }

  Connection& connection_;
  const double stall_s_;
  const std::atomic<bool>& stops_;
};

}  // namespace

struct Connections::Impl {
  Impl(Listener listening, TlsContext* tls_context, RequestHandler* answers, const ConnectionLimits& all_limits)
      : listener(std::move(listening)),
        tls(tls_context),
        handler(*answers),
        limits(all_limits),
        buffered(limits.buffered_bytes),
        lanes(std::make_unique<Lanes>(std::array<LaneLimits, Lanes::kLanes>{
            LaneLimits{limits.quick_threads, limits.waiting},
            LaneLimits{limits.slow_threads, limits.waiting, limits.slow_of_owner},
            LaneLimits{limits.file_threads, limits.waiting, limits.files_of_owner}, LaneLimits{limits.streams, 0}})) {}

  bool Open() {
    epoll = ::epoll_create1(EPOLL_CLOEXEC);
    wake = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (epoll < 0 || wake < 0) return false;
    for (const int fd : listener.sockets()) Watch(EPOLL_CTL_ADD, fd, EPOLLIN, nullptr);
    Watch(EPOLL_CTL_ADD, wake, EPOLLIN, nullptr);
    thread = std::thread([this] { Run(); });
    return true;
  }
  ~Impl() {
    stops = true;
    Wake();
    if (thread.joinable()) thread.join();
    lanes.reset();
    all.clear();
    if (epoll >= 0) ::close(epoll);
    if (wake >= 0) ::close(wake);
  }

  void Watch(int action, int fd, uint32_t events, Connection* connection) const {
    epoll_event event = {};
    event.events = events;
    event.data.ptr = connection;
    ::epoll_ctl(epoll, action, fd, &event);
  }
  void Wake() const {
    const uint64_t one = 1;
    if (::write(wake, &one, sizeof(one)) < 0) return;  // full: it is awake
  }

  void Run() {
    epoll_event events[kEvents];
    Steady::time_point swept = Steady::now();
    while (!stops) {
      const int n = ::epoll_wait(epoll, events, kEvents, kSweep_ms);
      bool others = false;
      for (int i = 0; i < n; ++i) {
        if (events[i].data.ptr == nullptr) {
          others = true;
        } else if (auto* const connection = static_cast<Connection*>(events[i].data.ptr); !ended.contains(connection)) {
          Advance(*connection);
        }
      }
      if (others) {
        uint64_t count = 0;
        while (::read(wake, &count, sizeof(count)) > 0) continue;
        TakeBack();
        for (const int fd : listener.sockets()) Accept(fd);
      }
      if (Steady::now() - swept > std::chrono::milliseconds(kSweep_ms)) {
        swept = Steady::now();
        Sweep(swept);
      }
      for (Connection* const connection : std::exchange(ended, {})) all.erase(connection);
      count = static_cast<int>(all.size());
    }
  }

  void Accept(int fd) {
    for (int i = 0; i < kAcceptsAtOnce; ++i) {
      const Listener::Accepted accepted = Listener::Accept(fd);
      if (accepted.fd < 0) return;
      const std::string key = AddressKey(accepted.host);
      const bool too_many_there = of_address[key] >= limits.of_address;
      if (too_many_there || (static_cast<int>(all.size() - ended.size()) >= limits.connections && !EndIdle())) {
        if (of_address[key] == 0) of_address.erase(key);
        Warn(key);
        if (tls == nullptr) {
          Socket socket(accepted.fd, nullptr);
          const std::string refusal = handler.Refusal(503);
          std::string_view rest = refusal;
          socket.Write(&rest);
        } else {
          ::close(accepted.fd);
        }
        continue;
      }
      auto connection = std::make_unique<Connection>(accepted.fd, tls == nullptr ? nullptr : tls->Current());
      Connection& added = *connection;
      added.key = key;
      added.peer = accepted.peer;
      added.idle_since = Steady::now();
      added.deadline = In(limits.request_s);
      ++of_address[key];
      all.emplace(&added, std::move(connection));
      Watch(EPOLL_CTL_ADD, accepted.fd, EPOLLIN, &added);
      if (tls == nullptr) added.state = ConnectionState::kReceiving;
    }
  }

  void Warn(const std::string& key) {
    if (Steady::now() < next_warning) return;
    next_warning = In(kBetweenWarnings_s);
    LogWarning("too many HTTP connections: further ones are refused",
               {{"connections", std::to_string(all.size())}, {"address", key}});
  }

  // Makes room; false if there is no idle connection.
  bool EndIdle() {
    Connection* chosen = nullptr;
    for (const auto& [connection, owned] : all) {
      const bool idle = connection->state == ConnectionState::kHandshake ||
                        connection->state == ConnectionState::kReceiving ||
                        connection->state == ConnectionState::kLingering;
      if (!idle || ended.contains(connection)) continue;
      if (chosen == nullptr || std::pair(-of_address[connection->key], connection->idle_since) <
                                   std::pair(-of_address[chosen->key], chosen->idle_since)) {
        chosen = connection;
      }
    }
    if (chosen == nullptr) return false;
    End(*chosen);
    return true;
  }

  void Sweep(Steady::time_point now) {
    for (const auto& [connection, owned] : all) {
      if (connection->state == ConnectionState::kAnswering || now < connection->deadline) continue;
      if (ended.contains(connection)) continue;
      connection->state == ConnectionState::kSending ? Break(*connection) : End(*connection);
    }
  }

  // Ends a connection without the rest of its answer, which would else stay in the kernel's memory.
  void Break(Connection& connection) {
    connection.socket.Abort();
    End(connection);
  }

  // The connection is destroyed after this round of events.
  void End(Connection& connection) {
    if (ended.contains(&connection)) return;
    Watch(EPOLL_CTL_DEL, connection.socket.fd(), 0, nullptr);
    Forget(connection);
    if (--of_address[connection.key] == 0) of_address.erase(connection.key);
    ended.insert(&connection);
  }
  void Forget(Connection& connection) {
    buffered.Remove(connection.answer.size());
    connection.answer = {};
    connection.sent = 0;
  }

  // Does what is possible without waiting.
  void Advance(Connection& connection) {
    switch (connection.state) {
      case ConnectionState::kHandshake:
        return Handshake(connection);
      case ConnectionState::kReceiving:
        return Receive(connection);
      case ConnectionState::kSending:
        Send(connection);
        if (connection.state == ConnectionState::kReceiving && !ended.contains(&connection)) Receive(connection);
        return;
      case ConnectionState::kLingering:
        return Linger(connection);
      case ConnectionState::kAnswering:
        return;
    }
  }

  // Waits for the socket, or ends the connection.
  void Await(Connection& connection, Socket::Result result) {
    if (result == Socket::Result::kClosed) return End(connection);
    Watch(EPOLL_CTL_MOD, connection.socket.fd(), result == Socket::Result::kWantsWrite ? EPOLLOUT : EPOLLIN,
          &connection);
  }

  void Handshake(Connection& connection) {
    const Socket::Result result = connection.socket.Handshake();
    if (result != Socket::Result::kDone) return Await(connection, result);
    connection.state = ConnectionState::kReceiving;
    Receive(connection);
  }

  void Receive(Connection& connection) {
    const size_t most = limits.frame.head_bytes + limits.frame.body_bytes;
    int at_once = 0;
    while (true) {
      if (!connection.received.empty()) {
        const Taken taken = Take(connection, at_once < kAnswersAtOnce);
        if (taken == Taken::kElsewhere) return;
        at_once += taken == Taken::kAnswered ? 1 : 0;
        if (taken == Taken::kAnswered) continue;
      }
      if (connection.received.size() >= most) return Refuse(connection, 413);
      const bool first = connection.received.empty();
      const Socket::Result result = connection.socket.Read(most - connection.received.size(), &connection.received);
      if (result != Socket::Result::kDone) return Await(connection, result);
      if (first) connection.deadline = In(limits.request_s);
    }
  }

  // kNothing: more bytes are needed; kAnswered: the next request may be received; kElsewhere: not to be received from.
  enum class Taken { kNothing, kAnswered, kElsewhere };

  // Answers or passes on a complete request, or refuses a wrong one.
  Taken Take(Connection& connection, bool at_once) {
    if (connection.received.size() < connection.awaited) return Taken::kNothing;
    RequestFrame frame = FindRequest(connection.received, limits.frame);
    if (frame.state == RequestFrame::State::kRefused) {
      Refuse(connection, frame.refusal);
      return Taken::kElsewhere;
    }
    if (frame.state == RequestFrame::State::kIncomplete) {
      if (frame.has_head) connection.awaited = frame.size_bytes;
      if (!frame.has_head || connection.continued || frame.expect.empty()) return Taken::kNothing;
      connection.continued = true;
      std::string_view go_on = "HTTP/1.1 100 Continue\r\n\r\n";
      connection.socket.Write(&go_on);
      return Taken::kNothing;
    }
    const auto request = std::make_shared<ReceivedRequest>();
    request->body = connection.received.substr(frame.size_bytes - frame.body_bytes, frame.body_bytes);
    connection.received.erase(0, frame.size_bytes);
    connection.awaited = 0;
    connection.continued = false;
    request->peer = connection.peer;
    request->tls = tls != nullptr;
    request->arrived = Steady::now();
    request->frame = std::move(frame);
    if (at_once && AnswerAtOnce(connection, *request)) {
      Flush(connection);
      return connection.state == ConnectionState::kReceiving && !ended.contains(&connection) ? Taken::kAnswered
                                                                                             : Taken::kElsewhere;
    }
    Watch(EPOLL_CTL_DEL, connection.socket.fd(), 0, nullptr);
    connection.state = ConnectionState::kAnswering;
    const Lane lane = handler.LaneOf(request->frame);
    const auto answer = [this, &connection, lane, request] { Answer(connection, lane, request.get()); };
    if (!lanes->Run(lane, handler.OwnerOf(lane, *request), answer)) {
      Watch(EPOLL_CTL_ADD, connection.socket.fd(), EPOLLOUT, &connection);
      Refuse(connection, 503);
    }
    return Taken::kElsewhere;
  }

  bool AnswerAtOnce(Connection& connection, const ReceivedRequest& request) {
    BufferedOutput output(connection, buffered);
    const std::optional<bool> goes_on = handler.ServeAtOnce(request, output);
    if (!goes_on) return false;
    connection.ends = !*goes_on || connection.broken;
    return true;
  }

  // Runs in a thread of the lane, which has the connection until it gives it back.
  void Answer(Connection& connection, Lane lane, ReceivedRequest* request) {
    bool goes_on = false;
    if (lane == Lane::kQuick || lane == Lane::kSlow) {
      BufferedOutput output(connection, buffered);
      goes_on = handler.Serve(std::move(*request), output);
    } else {
      PacedOutput output(connection, limits.stall_s, stops);
      goes_on = handler.Serve(std::move(*request), output);
    }
    connection.ends = !goes_on;
    {
      std::lock_guard lock(mutex);
      answered.push_back(&connection);
    }
    Wake();
  }

  void TakeBack() {
    std::vector<Connection*> back;
    {
      std::lock_guard lock(mutex);
      back.swap(answered);
    }
    for (Connection* const connection : back) {
      Watch(EPOLL_CTL_ADD, connection->socket.fd(), EPOLLIN, connection);
      if (connection->broken) {
        Break(*connection);
        continue;
      }
      Flush(*connection);
      if (connection->state == ConnectionState::kReceiving && !ended.contains(connection)) Receive(*connection);
    }
  }

  void Refuse(Connection& connection, int status) {
    const std::string refusal = handler.Refusal(status);
    connection.ends = true;
    if (!buffered.Add(refusal.size())) return End(connection);
    connection.answer = refusal;
    connection.sent = 0;
    Flush(connection);
  }

  // Begins to send an answer. Afterwards the connection may be in any state but kAnswering.
  void Flush(Connection& connection) {
    connection.state = ConnectionState::kSending;
    connection.deadline = In(limits.answer_s);
    Send(connection);
  }

  void Send(Connection& connection) {
    std::string_view rest = std::string_view(connection.answer).substr(connection.sent);
    const Socket::Result result = connection.socket.Write(&rest);
    connection.sent = connection.answer.size() - rest.size();
    if (result != Socket::Result::kDone) return Await(connection, result);
    Forget(connection);
    if (connection.ends) {
      connection.socket.EndWriting();
      connection.state = ConnectionState::kLingering;
      connection.deadline = In(kLinger_s);
      return Linger(connection);
    }
    connection.state = ConnectionState::kReceiving;
    connection.idle_since = Steady::now();
    connection.deadline = In(connection.received.empty() ? limits.idle_s : limits.request_s);
  }

  void Linger(Connection& connection) {
    std::string ignored;
    while (connection.lingered < kLingerBytes) {
      ignored.clear();
      const Socket::Result result = connection.socket.Read(kLingerBytes, &ignored);
      if (result != Socket::Result::kDone) return Await(connection, result);
      connection.lingered += ignored.size();
    }
    End(connection);
  }

  Listener listener;
  TlsContext* const tls;
  RequestHandler& handler;
  const ConnectionLimits limits;
  Buffered buffered;
  int epoll = -1, wake = -1;
  std::atomic<bool> stops = false;
  std::atomic<int> count = 0;
  // Of the receiving thread.
  std::unordered_map<Connection*, std::unique_ptr<Connection>> all;
  std::set<Connection*> ended;
  std::unordered_map<std::string, int> of_address;
  Steady::time_point next_warning;
  std::mutex mutex;
  std::vector<Connection*> answered;  // by a lane, to be taken back
  std::unique_ptr<Lanes> lanes;
  std::thread thread;
};

Connections::Connections(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Connections::~Connections() = default;

StatusOr<std::unique_ptr<Connections>> Connections::Listen(const std::string& address, TlsContext* tls,
                                                           RequestHandler* handler, const ConnectionLimits& limits) {
  TESSERA_ASSIGN_OR_RETURN(Listener listener, Listener::Open(address));
  auto impl = std::make_unique<Impl>(std::move(listener), tls, handler, limits);
  if (!impl->Open()) return absl::UnavailableError("cannot listen on " + address + ": no event queue");
  return std::unique_ptr<Connections>(new Connections(std::move(impl)));
}

const std::string& Connections::address() const { return impl_->listener.address(); }
int Connections::connections() const { return impl_->count; }
int Connections::threads() const { return impl_->lanes->threads(); }

}  // namespace tessera

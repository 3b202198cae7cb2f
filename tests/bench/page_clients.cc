#include "tests/bench/page_clients.h"

#include <sys/epoll.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string_view>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "common/storage/files.h"
#include "tests/bench/dispatch_fleet.h"
#include "tests/support/http_client.h"

namespace tessera {
namespace {

using Steady = std::chrono::steady_clock;

constexpr int kStreams = 64;  // that a coordinator has
constexpr double kPoll_s = 2, kTiles_s = 1, kTile_s = 0.008;
constexpr double kTurn_s = 6, kSettle_s = 2;  // the start of a turn is not counted

struct Counts {
  int64_t states = 0, unchanged = 0, tiles = 0, events = 0, bytes = 0, faults = 0;
  double longest_s = 0;  // from a request to its answer
};

double PageNow() { return std::chrono::duration<double>(Steady::now().time_since_epoch()).count(); }

// A connection that never waits; one request at a time.
class Connection {
 public:
  explicit Connection(int port) : http_("127.0.0.1:" + std::to_string(port)), good_(http_.connected()) {}

  int fd() const { return http_.fd(); }
  bool good() const { return good_; }
  void Get(const std::string& path, const std::string& etag) {
    SentHeaders headers = {{"Accept-Encoding", "gzip, deflate"}};
    if (!etag.empty()) headers.emplace_back("If-None-Match", etag);
    good_ = good_ && http_.Send(HttpConnection::Text("GET", path, headers, "", "127.0.0.1"));
  }
  // Takes what has arrived.
  void Receive(Counts& counts) {
    const size_t before = http_.received().size();
    good_ = http_.Receive(0);
    counts.bytes += static_cast<int64_t>(http_.received().size() - before);
  }
  // Takes a whole answer; false: not there yet.
  bool TakeAnswer(int* status, std::string* etag) {
    const size_t end = received().find("\r\n\r\n");
    if (end == std::string::npos) return false;
    const std::string_view head(received().data(), end + 2);
    const std::string length = ValueOf(head, "\r\nContent-Length: ");
    *status = std::atoi(received().c_str() + received().find(' ') + 1);
    const size_t size = end + 4 + (*status == 304 ? 0 : std::strtoul(length.c_str(), nullptr, 10));
    if (received().size() < size) return false;
    *etag = ValueOf(head, "\r\nETag: ");
    received().erase(0, size);
    return true;
  }
  // Takes all whole events; returns how many. Each is compressed, and ends with an empty block.
  int TakeEvents() {
    static constexpr std::string_view kEnd("\0\0\xff\xff", 4);
    int events = 0;
    size_t at = 0;
    for (size_t next = 0; (next = received().find(kEnd, at)) != std::string::npos; at = next + kEnd.size()) ++events;
    received().erase(0, std::max(at, received().size() - std::min(received().size(), kEnd.size() - 1)));
    return events;
  }

 private:
  static std::string ValueOf(std::string_view head, std::string_view name) {
    const size_t at = head.find(name);
    if (at == std::string_view::npos) return "";
    return std::string(head.substr(at + name.size(), head.find("\r\n", at + 2) - at - name.size()));
  }

  std::string& received() { return http_.received(); }

  HttpConnection http_;
  bool good_;
};

// One page.
class Page {
 public:
  Page(const std::string& job, int tiles, int port, bool streams, double start_s, Counts& counts)
      : path_("/api/v1/" + job),
        tiles_s_(std::max(kTiles_s, kTile_s * tiles)),
        counts_(counts),
        calls_(port),
        next_poll_s_(start_s) {
    if (streams) stream_ = std::make_unique<Connection>(port);
  }

  std::vector<Connection*> connections() {
    std::vector<Connection*> all = {&calls_};
    if (stream_ != nullptr) all.push_back(stream_.get());
    return all;
  }

  // Asks for what is due.
  void Step(double now_s) {
    if (asked_s_ > 0) return;
    if (wants_tiles_ && now_s >= next_tiles_s_) {
      wants_tiles_ = false;
      next_tiles_s_ = now_s + tiles_s_;
      Ask(path_ + "/tiles?pageSize=1000", "", now_s);
      ++counts_.tiles;
    } else if (now_s >= next_poll_s_) {
      // A page that follows the stream asks for the state only when it opens.
      next_poll_s_ = stream_ == nullptr ? now_s + kPoll_s : 1e18;
      polls_ = true;
      Ask(path_ + ":state", etag_, now_s);
      ++counts_.states;
    }
  }

  void Receive(Connection& connection) {
    connection.Receive(counts_);
    if (!connection.good()) ++counts_.faults;
    if (&connection == stream_.get()) {
      const int events = connection.TakeEvents();
      counts_.events += events;
      wants_tiles_ = wants_tiles_ || events > 0;
      return;
    }
    int status = 0;
    std::string etag;
    if (!connection.TakeAnswer(&status, &etag)) return;
    counts_.longest_s = std::max(counts_.longest_s, PageNow() - std::exchange(asked_s_, 0));
    if (status != 200 && status != 304) ++counts_.faults;
    if (!std::exchange(polls_, false)) return;
    if (status == 304) ++counts_.unchanged;
    if (status == 200) {
      etag_ = etag;
      wants_tiles_ = true;
    }
    if (stream_ != nullptr && !std::exchange(opened_, true)) {
      std::string seen = etag_;
      std::erase(seen, '"');
      stream_->Get(path_ + ":watch?seenEtag=" + seen, "");
    }
  }

 private:
  void Ask(const std::string& path, const std::string& etag, double now_s) {
    asked_s_ = now_s;
    calls_.Get(path, etag);
  }

  const std::string path_;
  const double tiles_s_;
  Counts& counts_;
  Connection calls_;
  std::unique_ptr<Connection> stream_;
  std::string etag_;
  double next_poll_s_, next_tiles_s_ = 0, asked_s_ = 0;
  bool wants_tiles_ = false, polls_ = false, opened_ = false;
};

// Until the file `open` is taken away.
void RunOpenPages(int pages, int tiles, const std::string& job, int port, const std::string& open, Counts& counts) {
  const int epoll = ::epoll_create1(EPOLL_CLOEXEC);
  struct Source {
    Page* page;
    Connection* connection;
  };
  std::vector<std::unique_ptr<Page>> all;
  std::vector<std::unique_ptr<Source>> sources;
  const double start_s = PageNow();
  const int apart = pages / std::min(pages, kStreams);  // pages from one that follows the stream to the next
  for (int i = 0; i < pages; ++i) {
    // Each at another time of the two seconds.
    const double at_s = start_s + kPoll_s * i / pages;
    const bool streams = i % apart == 0 && i / apart < kStreams;
    all.push_back(std::make_unique<Page>(job, tiles, port, streams, at_s, counts));
    for (Connection* const connection : all.back()->connections()) {
      sources.push_back(std::make_unique<Source>(Source{all.back().get(), connection}));
      epoll_event event = {};
      event.events = EPOLLIN;
      event.data.ptr = sources.back().get();
      ::epoll_ctl(epoll, EPOLL_CTL_ADD, connection->fd(), &event);
    }
  }
  double next_look_s = start_s;
  std::vector<epoll_event> events(256);
  while (true) {
    const int ready = ::epoll_wait(epoll, events.data(), static_cast<int>(events.size()), 5);
    for (int i = 0; i < ready; ++i) {
      const Source& source = *static_cast<Source*>(events[static_cast<size_t>(i)].data.ptr);
      source.page->Receive(*source.connection);
      if (!source.connection->good()) ::epoll_ctl(epoll, EPOLL_CTL_DEL, source.connection->fd(), nullptr);
    }
    const double now_s = PageNow();
    for (const auto& page : all) page->Step(now_s);
    if (now_s < next_look_s) continue;
    next_look_s = now_s + 0.05;
    if (!FileExists(open)) break;
  }
  ::close(epoll);
}

}  // namespace

void RunPageClients(int pages, int tiles, const std::string& job, const std::string& address, const std::string& open) {
  Counts counts;
  int port = 0;
  double open_s = 0;
  const double start_cpu_s = CpuSeconds(RUSAGE_SELF);
  while (port == 0 || FileExists(address)) {
    if (port == 0) {
      const std::string text = ReadFile(address).value_or("");
      if (!text.empty()) port = std::atoi(text.c_str() + text.rfind(':') + 1);
    } else if (FileExists(open)) {
      const double start_s = PageNow();
      RunOpenPages(pages, tiles, job, port, open, counts);
      open_s += PageNow() - start_s;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (open_s == 0) return;
  std::printf(
      "pages: %.1f states a second (%.0f %% unchanged), %.1f lists of tiles, %.1f events, %.2f MB a second, longest "
      "answer %.2f s, faults %lld; %.0f %% of a core for the clients\n",
      static_cast<double>(counts.states) / open_s,
      100.0 * static_cast<double>(counts.unchanged) / static_cast<double>(std::max<int64_t>(counts.states, 1)),
      static_cast<double>(counts.tiles) / open_s, static_cast<double>(counts.events) / open_s,
      1e-6 * static_cast<double>(counts.bytes) / open_s, counts.longest_s, static_cast<long long>(counts.faults),
      100 * (CpuSeconds(RUSAGE_SELF) - start_cpu_s) / open_s);
  std::fflush(stdout);
}

void PageTurns::Step(int tasks_done, double cpu_s) {
  const double now_s = PageNow();
  if (turn_s_ == 0) turn_s_ = now_s;
  if (!counts_ && now_s >= turn_s_ + kSettle_s) {
    counts_ = true;
    std::tie(count_s_, tasks_, cpu_s_) = std::tuple(now_s, tasks_done, cpu_s);
  }
  if (now_s < turn_s_ + kTurn_s) return;
  const int tasks = std::max(1, tasks_done - tasks_);
  turns_.push_back({is_open_, tasks / (now_s - count_s_), (cpu_s - cpu_s_) / tasks});
  is_open_ = !is_open_;
  (is_open_ ? WriteFileAtomic(open_, "") : RemoveTree(open_)).IgnoreError();
  counts_ = false;
  turn_s_ = now_s;
}

void PageTurns::End() {
  RemoveTree(open_).IgnoreError();
  // Each turn with pages beside the mean of those before and after it.
  std::vector<double> rates, cpus;
  double with = 0, without = 0, with_cpu_s = 0, without_cpu_s = 0;
  for (size_t i = 1; i + 1 < turns_.size(); ++i) {
    if (!turns_[i].open) continue;
    const double rate = 0.5 * (turns_[i - 1].tasks_per_s + turns_[i + 1].tasks_per_s);
    const double cpu_s = 0.5 * (turns_[i - 1].cpu_s_per_task + turns_[i + 1].cpu_s_per_task);
    rates.push_back(turns_[i].tasks_per_s / rate);
    cpus.push_back(turns_[i].cpu_s_per_task / cpu_s);
    with += turns_[i].tasks_per_s;
    without += rate;
    with_cpu_s += turns_[i].cpu_s_per_task;
    without_cpu_s += cpu_s;
  }
  if (rates.empty()) return;
  std::sort(rates.begin(), rates.end());
  std::sort(cpus.begin(), cpus.end());
  const auto n = static_cast<double>(rates.size());
  std::printf(
      "with / without pages, %zu turns of %.0f s: tasks a second %.0f / %.0f, ratio: median %.3f, from %.3f to %.3f; "
      "processor time of the coordinator a task %.3f / %.3f ms, ratio: median %.3f\n",
      rates.size(), kTurn_s, with / n, without / n, rates[rates.size() / 2], rates.front(), rates.back(),
      1e3 * with_cpu_s / n, 1e3 * without_cpu_s / n, cpus[cpus.size() / 2]);
}

}  // namespace tessera

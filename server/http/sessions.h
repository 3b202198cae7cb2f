// Who is logged in by a browser, and who guesses tokens.
#pragma once

#include <chrono>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

namespace tessera {

// Sessions of browsers, in memory only: a restart ends them. A session holds the token that it was begun with, which
// must be checked at each request. Thread-safe.
class Sessions {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::hours kIdle{12};
  static constexpr size_t kMax = 10'000, kMaxOfToken = 200;

  // Begins a session; returns its random id, the value of the cookie. Ends the one that was idle for longest if there
  // are too many, first of this token.
  std::string Begin(const std::string& token, Clock::time_point now);
  // The session's token; nullopt: no such session, or it was idle for kIdle.
  std::optional<std::string> TokenOf(const std::string& id, Clock::time_point now);
  void End(const std::string& id);
  size_t size() const;

 private:
  struct Session {
    std::string key, token;
    Clock::time_point used;
  };
  using Order = std::list<Session>;  // longest idle first
  void Remove(Order::iterator session);

  mutable std::mutex mutex_;
  Order order_;
  std::unordered_map<std::string, Order::iterator> by_key_;  // by SHA-256 of the id
  std::map<std::string, size_t> of_token_;
};

// Counts failed log-ins by address. Thread-safe.
class GuessLimits {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr int kMaxFailures = 10;  // in a window
  static constexpr std::chrono::seconds kWindow{60};
  static constexpr size_t kMaxAddresses = 4096;

  enum class Verdict { kUnknown, kFirstTooMany, kTooMany };
  // A token that does not exist came from this address. kFirstTooMany: once per address and window.
  Verdict Failed(const std::string& address, Clock::time_point now);

 private:
  struct Failures {
    int count = 0;
    Clock::time_point since;
  };
  std::mutex mutex_;
  std::unordered_map<std::string, Failures> failures_;
};

}  // namespace tessera

#include "server/http/sessions.h"

#include <iterator>

#include "common/access/secrets.h"
#include "common/storage/hash.h"

namespace tessera {

std::string Sessions::Begin(const std::string& token, Clock::time_point now) {
  const std::string id = RandomSecret();
  std::lock_guard lock(mutex_);
  if (of_token_[token] >= kMaxOfToken) {
    for (auto session = order_.begin(); session != order_.end(); ++session) {
      if (session->token != token) continue;
      Remove(session);
      break;
    }
  }
  if (order_.size() >= kMax) Remove(order_.begin());
  const auto added = order_.insert(order_.end(), {Sha256Hex(id), token, now});
  by_key_[added->key] = added;
  ++of_token_[token];
  return id;
}

std::optional<std::string> Sessions::TokenOf(const std::string& id, Clock::time_point now) {
  // Found by its hash: the time of the search tells nothing about other ids.
  const std::string key = Sha256Hex(id);
  std::lock_guard lock(mutex_);
  while (!order_.empty() && now - order_.front().used > kIdle) Remove(order_.begin());
  const auto found = by_key_.find(key);
  if (found == by_key_.end()) return std::nullopt;
  found->second->used = now;
  order_.splice(order_.end(), order_, found->second);
  return found->second->token;
}

void Sessions::End(const std::string& id) {
  const std::string key = Sha256Hex(id);
  std::lock_guard lock(mutex_);
  if (const auto found = by_key_.find(key); found != by_key_.end()) Remove(found->second);
}

size_t Sessions::size() const {
  std::lock_guard lock(mutex_);
  return order_.size();
}

void Sessions::Remove(Order::iterator session) {
  if (const auto counted = of_token_.find(session->token); --counted->second == 0) of_token_.erase(counted);
  by_key_.erase(session->key);
  order_.erase(session);
}

GuessLimits::Verdict GuessLimits::Failed(const std::string& address, Clock::time_point now) {
  std::lock_guard lock(mutex_);
  if (failures_.size() >= kMaxAddresses && !failures_.contains(address)) {
    std::erase_if(failures_, [&](const auto& entry) { return now - entry.second.since > kWindow; });
    if (failures_.size() >= kMaxAddresses) return Verdict::kTooMany;
  }
  Failures& failures = failures_[address];
  if (failures.count == 0 || now - failures.since > kWindow) failures = {0, now};
  ++failures.count;
  if (failures.count <= kMaxFailures) return Verdict::kUnknown;
  return failures.count == kMaxFailures + 1 ? Verdict::kFirstTooMany : Verdict::kTooMany;
}

}  // namespace tessera

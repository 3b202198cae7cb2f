#include "server/metrics/metrics_server.h"

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/metric_family.h>

#include <algorithm>
#include <exception>
#include <mutex>
#include <utility>
#include <vector>

#include "server/metrics/metric_families.h"

namespace tessera {
namespace {

constexpr int kThreads = 2;  // concurrent scrapes

class Page final : public prometheus::Collectable {
 public:
  explicit Page(MetricSources sources) : sources_(std::move(sources)) {}
  std::vector<prometheus::MetricFamily> Collect() const override {
    std::lock_guard lock(mutex_);
    return Families(sources_);
  }
  void Replace(MetricSources sources) {
    std::lock_guard lock(mutex_);
    sources_ = std::move(sources);
  }

 private:
  mutable std::mutex mutex_;
  MetricSources sources_;
};

// Accepts one HOST:PORT; the server's own syntax (several ports, options) is refused.
Status CheckAddress(const std::string& address) {
  const size_t colon = address.rfind(':');
  const std::string port = colon == std::string::npos ? "" : address.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  const bool plain = colon != std::string::npos && colon > 0 && address.find_first_of(",+ ") == std::string::npos;
  if (plain && digits && std::stoi(port) <= 65535) return absl::OkStatus();
  return absl::InvalidArgumentError("--metrics-listen: found '" + address +
                                    "', expected HOST:PORT as in 127.0.0.1:9464");
}

}  // namespace

struct MetricsServer::Impl {
  std::shared_ptr<Page> page;
  std::string address;
  std::unique_ptr<prometheus::Exposer> exposer;
};

MetricsServer::MetricsServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MetricsServer::~MetricsServer() = default;

const std::string& MetricsServer::address() const { return impl_->address; }

void MetricsServer::Replace(MetricSources sources) { impl_->page->Replace(std::move(sources)); }

StatusOr<std::unique_ptr<MetricsServer>> MetricsServer::Start(const std::string& address, MetricSources sources) {
  TESSERA_RETURN_IF_ERROR(CheckAddress(address));
  auto impl = std::make_unique<Impl>();
  impl->page = std::make_shared<Page>(std::move(sources));
  try {
    impl->exposer = std::make_unique<prometheus::Exposer>(address, kThreads);
    impl->exposer->RegisterCollectable(impl->page);
    const std::vector<int> ports = impl->exposer->GetListeningPorts();
    if (ports.empty()) return absl::UnavailableError("cannot listen on " + address + " for metrics");
    impl->address = address.substr(0, address.rfind(':') + 1) + std::to_string(ports.front());
  } catch (const std::exception& error) {
    return absl::UnavailableError("cannot listen on " + address + " for metrics: " + error.what());
  }
  return std::unique_ptr<MetricsServer>(new MetricsServer(std::move(impl)));
}

}  // namespace tessera

// Converts the coordinator's numbers to Prometheus metric families.
#pragma once

#include <vector>

#include "server/metrics/metrics_server.h"

namespace prometheus {
struct MetricFamily;
}  // namespace prometheus

namespace tessera {

std::vector<prometheus::MetricFamily> Families(const MetricSources& sources);

}  // namespace tessera

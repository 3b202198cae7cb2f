// Converts the coordinator's numbers to Prometheus metric families.
#pragma once

#include <vector>

#include "server/metrics/metrics_server.h"

namespace prometheus {
struct MetricFamily;
}  // namespace prometheus

namespace tessera {

// All metrics. Labels have a fixed set of values (kinds, classes, states, methods, codes, routes); no label holds a
// name that a user chose. Every family is present from the start; a coordinator that stands by has two.
std::vector<prometheus::MetricFamily> Families(const MetricSources& sources);

}  // namespace tessera

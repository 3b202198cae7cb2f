// Converts the coordinator's numbers to Prometheus metric families.
#ifndef TESSERA_SERVER_METRICS_METRIC_FAMILIES_H_
#define TESSERA_SERVER_METRICS_METRIC_FAMILIES_H_

#include <vector>

#include "server/metrics/metrics_server.h"

namespace prometheus {
struct MetricFamily;
}  // namespace prometheus

namespace tessera {

std::vector<prometheus::MetricFamily> Families(const MetricSources& sources);

}  // namespace tessera

#endif  // TESSERA_SERVER_METRICS_METRIC_FAMILIES_H_

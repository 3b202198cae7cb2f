// The job's report: what was done, where, and how much it changed.
#ifndef TESSERA_WORKER_TASKS_REPORT_H_
#define TESSERA_WORKER_TASKS_REPORT_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/tile/survey.h"

namespace tessera {

struct ReportedTile {
  int tile = 0;
  std::string report;  // JSON of the tile's core
};

// JSON, indented, deterministic (no times). `before`, `after`: the whole mesh, one topology, local frame.
std::string MakeReport(const Survey& survey, const TriangleMesh& before, const TriangleMesh& after,
                       const std::vector<ReportedTile>& tiles);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_REPORT_H_

// The interface of server/plan for server/jobs. Tests override it with small graphs.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/plan/graph.h"

namespace tessera {

// The functions of server/plan/graph.h. Thread-safe.
class Planner {
 public:
  virtual ~Planner() = default;
  virtual StatusOr<std::vector<PlannedTask>> Ingest(const JobSettings& settings,
                                                    const std::vector<std::string>& scene_files,
                                                    const std::vector<int64_t>& size_bytes) {
    return PlanIngest(settings, scene_files, size_bytes);
  }
  virtual StatusOr<std::vector<PlannedTask>> Update(const JobSettings& settings,
                                                    const std::vector<NamedDigest>& scene_files,
                                                    const UpdateBase& base) {
    return PlanUpdate(settings, scene_files, base);
  }
  // `base`: null if the job is no update. `fine`: null unless the job has split faces twice.
  virtual StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                                   const std::vector<std::string>& scene_files,
                                                   const UpdateBase* base, const FinePart* fine) {
    return PlanTiles(settings, survey, scene_files, base, fine);
  }
  virtual StatusOr<std::vector<PlannedTask>> Steps(const JobSettings& settings, const std::string& survey,
                                                   const std::vector<std::string>& scene_files,
                                                   const std::vector<TileReads>& reads, const UpdateBase* base,
                                                   const std::vector<FailedTile>& quarantined,
                                                   const FinePart* fine) {
    return PlanSteps(settings, survey, scene_files, reads, base, quarantined, fine);
  }
};

}  // namespace tessera

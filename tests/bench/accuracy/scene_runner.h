// Jobs on one scene, in this process, for the benches.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geodesy/frame.h"
#include "common/geometry/mesh.h"
#include "server/settings/job_settings.h"
#include "tests/support/in_process_line.h"
#include "tests/support/read_city.h"
#include "worker/city/city_file.h"

namespace tessera {

// Of this process, all threads.
double CpuSeconds();

StatusOr<TriangleMesh> ReadLocalMesh(const std::string& path, const Frame& frame);

// What several jobs need alike (ingest, cut) is done once, and its time told to each.
class SceneRunner {
 public:
  SceneRunner(std::string scene_folder, std::string work_folder, const Frame& frame)
      : scene_folder_(std::move(scene_folder)), work_folder_(std::move(work_folder)), frame_(frame) {}

  struct Result {
    TriangleMesh mesh;                    // local frame
    std::vector<PlannedTask> tasks;       // in the plan's order, ingest first
    std::map<std::string, double> cpu_s;  // by kind of task
    double all_cpu_s() const;
  };

  // Its mesh stays as `name`.ply in the work folder, and nothing else.
  StatusOr<Result> Run(const std::string& name, const JobSettings& settings);

  // The start with the faces of the last Run's result: repaired and split.
  StatusOr<City> Start() const;
  StatusOr<Survey> IngestedSurvey() const;

 private:
  struct Shared {
    std::string folder;
    TaskOutcome outcome;
    double cpu_s = 0;
  };

  StatusOr<TaskOutcome> RunShared(const TaskRequest& request, std::map<std::string, double>* cpu_s);

  std::string scene_folder_, work_folder_, ingested_;
  Frame frame_;
  std::map<std::string, Shared> shared_;
};

}  // namespace tessera

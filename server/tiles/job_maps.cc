#include "server/tiles/job_maps.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "common/job/task_parameters.h"

namespace tessera {
namespace {

constexpr int kMaxTasksSearched = 10'000;  // of a job without cuts: it has a few tasks, or waits for its survey

const StoredFile* FindOutput(const JobTask& task, const char* name) {
  const auto found = std::find_if(task.outputs.begin(), task.outputs.end(),
                                  [&](const StoredFile& output) { return output.name == name; });
  return task.state == TaskState::kSucceeded && found != task.outputs.end() ? &*found : nullptr;
}

// A cut has the cores of all tiles. -1: there is none.
int FindCut(const Job& job) {
  for (const auto& [number, tile] : job.totals.tiles()) {
    if (!tile.tasks.empty() && job.tasks[tile.tasks.front()].plan.kind == kCutKind) return tile.tasks.front();
  }
  return -1;
}

int FindPublish(const Job& job) {
  const int size = static_cast<int>(job.tasks.size());
  for (int i = size - 1; i >= std::max(0, size - kMaxTasksSearched); --i) {
    if (job.tasks[i].plan.kind == kPublishKind && !job.tasks[i].superseded) return i;
  }
  return -1;
}

const StoredFile* FindSurvey(const Job& job, int cut) {
  if (cut >= 0) {
    for (const PlannedInput& input : job.tasks[cut].plan.inputs) {
      if (!(input.output == kPlainSurveyFile)) continue;
      return FindOutput(job.tasks[input.task.value()], kSurveyFile);
    }
  }
  const int size = std::min(static_cast<int>(job.tasks.size()), kMaxTasksSearched);
  for (int i = 0; i < size; ++i) {
    if (const StoredFile* const survey = FindOutput(job.tasks[i], kSurveyFile)) return survey;
  }
  return nullptr;
}

// Centre and optical axis.
std::pair<Eigen::Vector3d, Eigen::Vector3d> PoseInTiles(const StatusOr<PointLocator>& locator,
                                                        const PosedCamera& camera) {
  const std::pair<Eigen::Vector3d, Eigen::Vector3d> unknown = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  if (!locator.ok()) return unknown;
  const Eigen::Vector3d axis = camera.rotation_cam_from_world.row(2).transpose();
  const auto centre = locator->TilesFromLocal(camera.Centre()), ahead = locator->TilesFromLocal(camera.Centre() + axis);
  return centre.ok() && ahead.ok() ? std::pair(*centre, Eigen::Vector3d((*ahead - *centre).normalized())) : unknown;
}

StatusOr<std::vector<CellRect>> CoresIn(const std::string& kind, const std::string& parameters) {
  if (kind == kCutKind) {
    TESSERA_ASSIGN_OR_RETURN(CutParameters cut, ParseCutParameters(parameters));
    return std::move(cut.cores);
  }
  TESSERA_ASSIGN_OR_RETURN(const PublishParameters publish, ParsePublishParameters(parameters));
  std::vector<CellRect> cores;
  for (const TileParameters& tile : publish.tiles) cores.push_back(tile.core);
  return cores;
}

}  // namespace

std::optional<JobMaps::Source> JobMaps::FindSource(const Job& job, int index) {
  const int cut = FindCut(job);
  const StoredFile* const survey = FindSurvey(job, cut);
  if (survey == nullptr) return std::nullopt;
  return Source{index, survey->digest(), cut >= 0 ? cut : FindPublish(job)};
}

std::shared_ptr<JobMaps::Entry> JobMaps::EntryOf(const Source& source) {
  std::lock_guard lock(mutex_);
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const std::shared_ptr<Entry>& entry) { return entry->source == source; });
  if (found != entries_.end()) {
    entries_.splice(entries_.begin(), entries_, found);
  } else {
    std::erase_if(entries_, [&](const std::shared_ptr<Entry>& entry) { return entry->source.job == source.job; });
    entries_.push_front(std::make_shared<Entry>());
    entries_.front()->source = source;
    if (entries_.size() > kKept) entries_.pop_back();
  }
  return entries_.front();
}

StatusOr<std::shared_ptr<const JobMap>> JobMaps::Make(const Source& source) const {
  std::string kind, parameters;
  if (source.tiles_from >= 0) {
    std::lock_guard lock(core_.mutex());
    const std::deque<JobTask>& tasks = core_.ledger().jobs()[source.job].tasks;
    if (source.tiles_from >= static_cast<int>(tasks.size())) {  // the job was deleted or restarted meanwhile
      return absl::NotFoundError("the plan of " + JobName(source.job) + " has changed; ask again");
    }
    kind = tasks[source.tiles_from].plan.kind;
    parameters = tasks[source.tiles_from].plan.parameters;
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string json, core_.environment().blobs->Read(source.survey));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(json));
  std::vector<CellRect> cores;
  if (source.tiles_from >= 0) {
    TESSERA_ASSIGN_OR_RETURN(cores, CoresIn(kind, parameters));
  }
  auto map = std::make_shared<JobMap>();
  map->ground = MakeGroundMap(survey, cores);
  map->locator = PointLocator::Open(survey);  // the map is of use without it
  for (const SceneView& view : survey.views) map->views_in_tiles.push_back(PoseInTiles(map->locator, view.camera));
  return std::shared_ptr<const JobMap>(std::move(map));
}

StatusOr<std::shared_ptr<const JobMap>> JobMaps::Of(const std::string& name) {
  std::optional<Source> source;
  {
    std::lock_guard lock(core_.mutex());
    TESSERA_ASSIGN_OR_RETURN(const int job, core_.ledger().FindJob(name));
    source = FindSource(core_.ledger().jobs()[job], job);
  }
  if (!source) return std::shared_ptr<const JobMap>();
  const std::shared_ptr<Entry> entry = EntryOf(*source);
  std::lock_guard lock(entry->making);
  if (entry->map == nullptr) {
    TESSERA_ASSIGN_OR_RETURN(entry->map, Make(*source));
  }
  return entry->map;
}

}  // namespace tessera

// Lineage of tiles: which job of a chain of updates refined each tile, and from which images.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"

namespace tessera {

// Why an update refined a tile again: a reason of kUpdateFile and its images.
struct RedoReason {
  std::string reason;
  std::vector<std::string> images;
};

// What lineage needs of a job that succeeded.
struct LineageJob {
  std::string name;  // "jobs/J"
  std::string display_name;
  std::string base;  // base job; empty: none
  std::string method;
  std::string algorithm_version;  // empty: an earlier release did not write it
  int64_t finished_s = 0;         // Unix time; not in job.json
  bool from_scratch = false;      // refines from the start mesh although it has a base
  Digest survey;
  std::vector<TileParameters> tiles;             // ascending
  std::map<int, Digest> made;                    // by tile: last state that a task of this job wrote
  std::map<int, Digest> inherited;               // by tile: state taken from the base job or from rollback_to
  std::map<int, std::vector<RedoReason>> redos;  // by tile: why an update refined it again
  std::string rollback_to;                       // job of the chain that `rolled_back` was restored from; empty: none
  std::set<int> rolled_back;                     // tiles
};

// `job`: job.json. `update`: kUpdateFile, empty if the job is no update. Parses one task at a time to bound memory.
// DATA_LOSS if the files are malformed; FAILED_PRECONDITION if the job has no result.
StatusOr<LineageJob> ParseLineageJob(const std::string& job, const std::string& update);

// Sorted names of the images of one flight that a tile was refined from.
struct FlightImages {
  std::string flight, date;
  std::vector<std::string> images;
};

// In the survey's order of flights; flights without an image of the tile are left out.
std::vector<FlightImages> ImagesOfTile(const Survey& survey, const CellRect& core);

struct TileLineage {
  TileParameters tile;
  size_t made_by = 0;  // index in the chain
  Digest state;
  std::optional<std::vector<FlightImages>> images;  // unset: the survey of that job is no longer stored
};

struct Lineage {
  std::vector<LineageJob> chain;  // the job, its base job, the base job of that, ...
  std::vector<TileLineage> tiles;
};

// For each tile of the first job, finds the newest job of the chain that refined it; does not fill in images. DATA_LOSS
// if no job refined a tile, or if a later job inherited another state than that job wrote.
StatusOr<Lineage> TraceTiles(std::vector<LineageJob> chain);

// Fills in the images of all tiles, or only of `tile` if it is not negative. `read` returns the content of a survey and
// is called once per job that refined a tile; NOT_FOUND leaves the images of its tiles unset.
Status FillImages(const std::function<StatusOr<std::string>(const Digest&)>& read, int tile, Lineage* lineage);

}  // namespace tessera

// Where each tile of a job comes from: which job of a chain of updates made it, and from which images.
#ifndef TESSERA_SERVER_CLIENT_LINEAGE_H_
#define TESSERA_SERVER_CLIENT_LINEAGE_H_

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

// Why an update redid a tile: a reason of kUpdateFile and its images.
struct RedoReason {
  std::string reason;
  std::vector<std::string> images;
};

// A job that succeeded, as far as lineage needs it.
struct LineageJob {
  std::string name;  // "jobs/J"
  std::string display_name;
  std::string base;  // the job that it goes on from; empty: none
  std::string method;
  std::string algorithm_version;  // empty: the job is older than this was written down
  int64_t finished_s = 0;         // Unix time; not in job.json
  bool from_scratch = false;      // all tiles from the start mesh, though it has a base
  Digest survey;
  std::vector<TileParameters> tiles;             // ascending
  std::map<int, Digest> made;                    // by tile: the last state that a task of this job left
  std::map<int, Digest> taken;                   // by tile: the state that it took from its base, or from rollback_to
  std::map<int, std::vector<RedoReason>> redos;  // by tile that images touched, of an update
  std::string rollback_to;                       // the job of the chain that it took these tiles from; empty: none
  std::set<int> rolled_back;
};

// `job`: job.json. `update`: kUpdateFile, empty if the job is no update. Reads a task at a time: a city's have much
// text. DATA_LOSS if they are not what jobs publish; FAILED_PRECONDITION if the job has no result.
StatusOr<LineageJob> ParseLineageJob(const std::string& job, const std::string& update);

// Names of those images of a flight that the cells of a tile chose, sorted.
struct FlightImages {
  std::string flight, date;
  std::vector<std::string> images;
};

// By the survey's order of flights, without those of which no image was chosen.
std::vector<FlightImages> ImagesOfTile(const Survey& survey, const CellRect& core);

struct TileLineage {
  TileParameters tile;
  size_t made_by = 0;  // place in the chain
  Digest state;
  std::optional<std::vector<FlightImages>> images;  // none: the survey of that job is not stored any more
};

struct Lineage {
  std::vector<LineageJob> chain;  // the job, its base, the base's base, ...
  std::vector<TileLineage> tiles;
};

// Finds the newest job of the chain that made each tile of the first, without images; checks that all jobs from there
// on handed on the same state. DATA_LOSS if they did not, or nothing made a tile.
StatusOr<Lineage> TraceTiles(std::vector<LineageJob> chain);

// Fills in the images of the tiles; `tile`: only of this one, if it is not negative. `read` gives the content of a
// survey: each is asked for that of the job that made it, once a job; NOT_FOUND leaves the images unknown.
Status FillImages(const std::function<StatusOr<std::string>(const Digest&)>& read, int tile, Lineage* lineage);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_LINEAGE_H_

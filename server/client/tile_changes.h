// Tile meshes that differ between two jobs.
#pragma once

#include <string>
#include <vector>

namespace tessera {

namespace v1 {
class Job;
}  // namespace v1

// A tile's mesh, "tiles/X_Y.ply".
struct TileFileChange {
  std::string name;
  std::string old_sha256, new_sha256;  // empty: the job has no such file
  bool changed() const { return old_sha256 != new_sha256; }
};

// The tile meshes of both jobs, by name.
std::vector<TileFileChange> CompareTileFiles(const v1::Job& base, const v1::Job& job);

// `job` with fewer artifacts: only changed tile meshes and all JSON files.
v1::Job OnlyChanged(const v1::Job& job, const std::vector<TileFileChange>& changes);

// Content of changed.json, which `fetch --changed-since` writes.
std::string ChangesJson(const v1::Job& base, const v1::Job& job, const std::vector<TileFileChange>& changes);

}  // namespace tessera

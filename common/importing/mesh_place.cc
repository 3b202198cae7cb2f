#include "common/importing/mesh_place.h"

#include <Eigen/Geometry>
#include <filesystem>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/importing/proof/residuals.h"
#include "common/meshio/mesh_format.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

// The box of the vertices of one file, and its labels.
struct BoxSink : MeshSink {
  Status Begin(const MeshLayout& layout) override {
    label_property = layout.label_property;
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d& position, int32_t) override { box.extend(position); }
  void AddFace(const Triangle&, int32_t) override {}
  Eigen::AlignedBox3d box;
  std::string label_property;
};

Eigen::AlignedBox3d BoxOf(const ImportedBlock& placed) {
  Eigen::AlignedBox3d box;
  for (const BlockTiePoint& point : placed.points) {
    if (HasPosition(point)) box.extend(point.position);
  }
  if (!box.isEmpty()) return box;
  for (const BlockImage& image : placed.images) {
    if (image.oriented) box.extend(image.centre);
  }
  return box;
}

struct Candidate {
  SourceCoordinates coordinates;
  std::string text;
};

std::vector<Candidate> CandidatesOf(const MeshSource& mesh, const std::string& crs, const ImportedBlock& source,
                                    const std::string& source_crs) {
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  if (!crs.empty()) return {{{crs, none}, "the system of --mesh-crs"}};
  if (!mesh.crs.empty()) return {{{mesh.crs, none}, "the system that the mesh's files name"}};
  if (!source.mesh_crs.empty()) return {{{source.mesh_crs, none}, "the system that the block states for meshes"}};
  if (!mesh.offset.isZero()) return {{{source_crs, none}, "the block's system, with the mesh's offset"}};
  std::vector<Candidate> candidates = {{{source_crs, none}, "the block's system, without an offset"}};
  if (!source.offset.isZero()) {
    candidates.push_back({{source_crs, source.offset}, "the block's system, with the block's offset"});
  }
  return candidates;
}

}  // namespace

StatusOr<MeshPlace> PlaceMesh(const MeshSource& mesh, const std::string& crs, const ImportedBlock& source,
                              const std::string& source_crs, const PlacedBlock& placed, const HeightOptions& heights) {
  BoxSink sink;
  if (!StreamMesh(mesh.files.front(), {}, &sink).ok()) {  // several properties may be labels
    MeshReadOptions without_labels;
    without_labels.label_property = "";
    sink = BoxSink();
    TESSERA_RETURN_IF_ERROR(StreamMesh(mesh.files.front(), without_labels, &sink));
  }
  if (sink.box.isEmpty()) return InputError(mesh.files.front(), "", "no vertices", "a mesh");
  const Eigen::AlignedBox3d block = BoxOf(placed.block);
  std::optional<MeshPlace> best;
  double nearest = std::numeric_limits<double>::infinity();
  Status first_error;
  for (Candidate& candidate : CandidatesOf(mesh, crs, source, source_crs)) {
    Eigen::Vector3d middle = sink.box.center() + mesh.offset;
    StatusOr<SceneMap> map = SceneMap::Open(candidate.coordinates, placed.map.scene(), heights, middle);
    Status status = map.status();
    if (status.ok()) status = map->SceneFromSource({&middle, 1});
    if (!status.ok()) {
      first_error.Update(status);
      continue;
    }
    const double distance = block.isEmpty() ? 0 : block.exteriorDistance(middle);
    if (distance >= nearest) continue;
    nearest = distance;
    best.emplace(
        MeshPlace{*std::move(map), std::move(candidate.coordinates), std::move(candidate.text), sink.label_property});
  }
  if (best) return *std::move(best);
  return InputError(mesh.files.front(), "",
                    absl::StrCat("coordinates that cannot be converted: ", first_error.message()),
                    "a mesh in the block's system: state its system by --mesh-crs");
}

std::string MeshOfSource(const std::string& source) {
  for (const char* name : {"odm_texturing/odm_textured_model_geo.obj", "odm_texturing_25d/odm_textured_model_geo.obj",
                           "odm_meshing/odm_mesh.ply", "odm_meshing/odm_25dmesh.ply"}) {
    const fs::path path = fs::path(source) / name;
    if (fs::is_regular_file(path)) return path.string();
  }
  return "";
}

}  // namespace tessera

#include "common/importing/import.h"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "common/base/machine_limits.h"
#include "common/blocks/block_format.h"
#include "common/check/check.h"
#include "common/importing/import_report.h"
#include "common/importing/mesh_place.h"
#include "common/importing/mesh_tiles.h"
#include "common/importing/proof/patch_proof.h"
#include "common/importing/proof/proof.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

// Of the progress. The check, which decodes all images, has most of the time.
constexpr double kReadShare = 0.03, kProvenShare = 0.08, kMeshShare = 0.2;

Status CheckOut(const std::string& out) {
  std::error_code error;
  if (!fs::exists(out, error) || (fs::is_directory(out, error) && fs::is_empty(out, error))) return absl::OkStatus();
  return absl::AlreadyExistsError(
      absl::StrCat(out, ": found a file or a folder with files, expected a new or empty folder: choose another --out"));
}

// One placement of the block, with its proof.
struct Placement {
  PlacedBlock placed;
  Proof proof;
  Warnings warnings;
};

// `alternatives`: as in ProofOptions.
StatusOr<Placement> Place(const ImportedBlock& block, FrameChoice choice, const ImportOptions& options,
                          bool alternatives) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(PlacedBlock placed, PlaceBlock(block, choice, {options.crs, options.heights}, &warnings));
  ProofOptions proof_options;
  proof_options.max_error_px = options.max_error_px;
  proof_options.alternatives = alternatives;
  Proof proof = MeasureProof(&placed.block, proof_options);
  return Placement{std::move(placed), std::move(proof), std::move(warnings)};
}

// Whether the tie points fit `other` better by a tenth.
bool IsBetterFrame(const Proof& other, const Proof& taken) {
  return other.is_proven && other.sample.median_px < 0.9 * taken.sample.median_px;
}

// The block in scene coordinates. Measures both frames, if they differ, and takes the chosen one, or without a choice
// the better one. Warns if the other one fits better.
StatusOr<Placement> ChooseFrame(const ImportedBlock& block, const ImportOptions& options, ImportFacts* facts) {
  const FrameChoice usual = options.frame.value_or(block.adjusted_in_grid ? FrameChoice::kGrid : FrameChoice::kTrue);
  const FrameChoice second = usual == FrameChoice::kGrid ? FrameChoice::kTrue : FrameChoice::kGrid;
  TESSERA_ASSIGN_OR_RETURN(Placement placement, Place(block, usual, options, /*alternatives=*/true));
  const StatusOr<Placement> other = Place(block, second, options, /*alternatives=*/false);
  // A reference system may allow one of them only.
  if (!other.ok() || other->placed.true_frame == placement.placed.true_frame) return placement;
  const bool better = IsBetterFrame(other->proof, placement.proof);
  facts->other_frame = (better && !options.frame ? placement : *other).proof.sample;
  if (better && !options.frame) return Place(block, second, options, /*alternatives=*/true);
  if (better) {
    placement.warnings.push_back(
        absl::StrCat(options.source, ": the tie points fit --frame ", second == FrameChoice::kGrid ? "grid" : "true",
                     " better: ", ResidualText(other->proof.sample.median_px), ", and ",
                     ResidualText(placement.proof.sample.median_px), " in the frame that was chosen"));
  }
  return placement;
}

StatusOr<MergeOptions> MergeOptionsOf(const ImportOptions& options) {
  constexpr std::string_view kProperty = "property:";
  MergeOptions merge;
  if (options.labels == "material") {
    merge.labels = LabelSource::kMaterial;
  } else if (options.labels.starts_with(kProperty) && options.labels.size() > kProperty.size()) {
    merge.labels = LabelSource::kProperty;
    merge.label_property = options.labels.substr(kProperty.size());
  } else if (options.labels != "none") {
    return InputError("--labels", "", absl::StrCat("'", options.labels, "'"), "none, material or property:NAME");
  }
  for (const SceneClass& known : KnownClasses()) merge.classes.push_back(known.name);
  if (options.class_file.empty()) return merge;
  if (merge.labels == LabelSource::kNone) {
    return InputError("--classes", "", "no --labels", "--labels material or --labels property:NAME beside it");
  }
  TESSERA_ASSIGN_OR_RETURN(merge.class_map, ReadClassMap(options.class_file));
  return merge;
}

// Replaces the temporary folder's path in messages.
std::string InMessages(const std::string& text, const std::string& folder, const std::string& out) {
  return absl::StrReplaceAll(text, {{folder, out}});
}

Status InMessages(const Status& status, const std::string& folder, const std::string& out) {
  if (status.ok()) return status;
  Status error(status.code(), InMessages(std::string(status.message()), folder, out));
  SetFaults(error, FaultsOf(status));
  return error;
}

// Checks the scene in `folder` as a job would; without a mesh only its files.
Status CheckWritten(const std::string& folder, const std::string& out, const ImportOptions& options,
                    const ImportedScene& scene, bool has_tie_points, ImportFacts* facts, Warnings* warnings,
                    const TaskControl& control) {
  SceneLoadOptions load;
  load.anyway = options.anyway;
  load.needs_mesh = facts->mesh.has_value();
  load.to_be_classified = load.by_default_rule = load.needs_mesh && scene.class_names.empty();
  constexpr int64_t kBytesOfFace = 1000;  // of the mesh and what CheckScene keeps of it
  const int64_t max_faces = std::max<int64_t>(1'000'000, MemoryLimit_bytes() / 2 / kBytesOfFace);
  Warnings found;
  const auto add_found = [&] {
    for (const std::string& warning : found) warnings->push_back(InMessages(warning, folder, out));
  };
  if (!load.needs_mesh) {
    const Status loaded = LoadScene(folder, &found, load).status();
    add_found();
    return InMessages(loaded, folder, out);
  }
  const StatusOr<CheckedScene> checked = CheckScene(folder, load, max_faces, &found, control);
  add_found();
  if (!checked.ok()) return InMessages(checked.status(), folder, out);
  if (has_tie_points || !checked->summary.fit) return absl::OkStatus();
  facts->patches = ProveByPatches(*checked->summary.fit);
  const Status proven = JudgePatchProof(options.source, *facts->patches, options.max_error_px, warnings);
  if (proven.ok() || !options.anyway) return proven;
  warnings->push_back(std::string(proven.message()));
  return absl::OkStatus();
}

}  // namespace

StatusOr<ImportResult> ImportScene(const ImportOptions& options, const std::string& out, Warnings* warnings,
                                   const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(CheckOut(out));
  Faults faults;
  control.Report(0, "reading the block");
  BlockReadOptions read;
  read.component = options.component;
  read.photographs = options.photographs;
  const ImportedBlock block = ReadBlock(options.source, options.format, read, &faults, warnings);
  const bool is_whole = faults.empty();
  StatusOr<MergeOptions> merging = MergeOptionsOf(options);
  faults.Add(merging.status());
  const Status crs_status =
      options.crs.empty() ? absl::OkStatus() : ReferenceSystem::Parse(options.crs, options.heights).status();
  faults.Add(crs_status);
  const std::string& crs = options.crs.empty() ? block.crs : options.crs;
  ImportFacts facts;
  facts.options = &options;
  facts.out = out;
  ImportedScene scene;
  scene.images = FindImages(block, options.source, options.photographs, &faults);
  const std::string mesh_path = options.mesh.empty() ? MeshOfSource(options.source) : options.mesh;
  MeshSource mesh;
  if (!mesh_path.empty()) {
    StatusOr<MeshSource> found = FindMeshSource(mesh_path);
    faults.Add(found.status());
    if (found.ok()) mesh = *std::move(found);
  }
  TESSERA_RETURN_IF_ERROR(control.Check());
  if (!is_whole || !crs_status.ok()) return faults.ToStatus();  // the proof needs both

  control.Report(kReadShare, "proving the conventions on the tie points");
  StatusOr<Placement> chosen = ChooseFrame(block, options, &facts);
  faults.Add(chosen.status());
  if (!chosen.ok()) return faults.ToStatus();
  Placement& placement = *chosen;
  warnings->insert(warnings->end(), placement.warnings.begin(), placement.warnings.end());
  PlacedBlock& placed = placement.placed;
  ProofOptions proof_options;
  proof_options.max_error_px = options.max_error_px;
  const Status fits = JudgeProof(placed.block, placement.proof, proof_options, warnings);
  if (!options.anyway) faults.Add(fits);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  if (!fits.ok()) warnings->push_back(std::string(fits.message()));
  TESSERA_RETURN_IF_ERROR(control.Check());
  MergeOptions& merge = *merging;

  // The scene is made beside its place, and renamed when it is whole.
  const std::string path = AbsolutePath(out);
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder,
                           TempFolder::Create(fs::path(path).parent_path().string(), ".tessera-import-"));
  std::optional<SceneSource> source_of_mesh;
  if (!mesh_path.empty()) {
    TESSERA_ASSIGN_OR_RETURN(const MeshPlace place,
                             PlaceMesh(mesh, options.mesh_crs, block, crs, placed, options.heights));
    if (merge.labels == LabelSource::kNone && !place.label_property.empty()) {
      warnings->push_back(absl::StrCat(
          mesh.files.front(), ": has labels, which are not read: add --labels property:", place.label_property));
    }
    merge.scene_from_source = [&](const Eigen::Vector3d& point) {
      Eigen::Vector3d in_scene = point;
      // MergeMeshes refuses what is not finite.
      if (!place.map.SceneFromSource({&in_scene, 1}).ok()) in_scene.setConstant(std::nan(""));
      return in_scene;
    };
    merge.control = PartOf(control, kProvenShare, kMeshShare);
    TESSERA_ASSIGN_OR_RETURN(facts.mesh, MergeMeshes(mesh, merge, folder.path() + "/mesh.ply", warnings));
    if (merge.labels != LabelSource::kNone) scene.class_names = facts.mesh->classes;
    facts.mesh_place = place.text;
    source_of_mesh = SceneSource{place.coordinates.crs, place.coordinates.offset + mesh.offset, mesh.tile_names,
                                 facts.mesh->tile_rects, options.heights};
  } else {
    warnings->push_back("the scene has no mesh: add --mesh; without one it can only be a new flight of an earlier job");
  }

  control.Report(kMeshShare, "writing the scene");
  scene.name = fs::path(path).filename().string();
  scene.block = &placed.block;
  scene.crs = placed.map.scene();
  if (source_of_mesh) {
    scene.source = std::move(source_of_mesh);
  } else if (placed.map.source().kind() != ReferenceSystem::Kind::kLocal) {
    scene.source = SceneSource{block.mesh_crs.empty() ? crs : block.mesh_crs, block.offset};
    scene.source->heights = options.heights;
  }
  scene.flights = options.flights;
  scene.copy_images = options.copy_images;
  TESSERA_RETURN_IF_ERROR(WriteScene(scene, folder.path()));
  TESSERA_RETURN_IF_ERROR(CheckWritten(folder.path(), path, options, scene, placement.proof.is_proven, &facts, warnings,
                                       PartOf(control, kMeshShare, 1)));
  facts.mesh_source = &mesh;
  facts.scene = &scene;
  facts.placed = &placed;
  facts.proof = &placement.proof;
  facts.source_crs = crs;
  facts.offset = block.offset;
  facts.warnings = *warnings;
  ImportResult result;
  TESSERA_ASSIGN_OR_RETURN(result.json, ImportJson(facts));
  result.text = ImportText(facts);
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder.path() + "/import.json", result.json));
  const mode_t mask = umask(0);
  umask(mask);
  std::error_code error;
  fs::permissions(folder.path(), static_cast<fs::perms>(0777 & ~mask), error);
  TESSERA_RETURN_IF_ERROR(RenameDurably(folder.path(), path));
  return result;
}

}  // namespace tessera

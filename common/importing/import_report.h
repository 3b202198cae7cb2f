// What an import did: import.json, and the table for users.
#pragma once

#include <optional>
#include <string>

#include "common/importing/import.h"
#include "common/importing/mesh_tiles.h"
#include "common/importing/proof/patch_proof.h"
#include "common/importing/proof/proof.h"

namespace tessera {

struct ImportFacts {
  const ImportOptions* options = nullptr;
  std::string out;
  const PlacedBlock* placed = nullptr;
  const ImportedScene* scene = nullptr;
  const Proof* proof = nullptr;
  std::optional<ResidualSummary> other_frame;  // of the sample, in the frame that was not taken
  std::string source_crs;                      // empty: none
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  const MeshSource* mesh_source = nullptr;
  std::optional<MergedMesh> mesh;  // none without a mesh
  std::string mesh_place;
  std::optional<PatchProof> patches;  // if the tie points prove nothing and there is a mesh
  Warnings warnings;
};

// Hashes the files of the source. Errors of reading them.
StatusOr<std::string> ImportJson(const ImportFacts& facts);

std::string ImportText(const ImportFacts& facts);

}  // namespace tessera

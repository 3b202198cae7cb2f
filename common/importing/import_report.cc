#include "common/importing/import_report.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

// The scene's frame in words.
std::string FrameText(const ImportFacts& facts) {
  const ReferenceSystem& source = facts.placed->map.source();
  if (source.kind() == ReferenceSystem::Kind::kLocal) return "local coordinates, as in the source";
  if (facts.placed->map.keeps_coordinates()) return absl::StrCat(source.name(), ", coordinates as in the source");
  return absl::StrCat("east-north-up, converted from ", source.name());
}

int64_t ImagesOf(const ImportFacts& facts) {
  return std::count_if(facts.scene->images.begin(), facts.scene->images.end(),
                       [](const FoundImage& image) { return !image.file.empty(); });
}

Json ResidualsJson(const ResidualSummary& residuals) {
  return {{"median_px", residuals.median_px}, {"p95_px", residuals.p95_px}, {"observations", residuals.observations}};
}

StatusOr<Json> FilesJson(const std::vector<std::string>& files) {
  Json out = Json::array();
  for (const std::string& file : files) {
    TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(file));
    out.push_back({{"path", file}, {"sha256", digest.sha256}, {"bytes", digest.size_bytes}});
  }
  return out;
}

}  // namespace

StatusOr<std::string> ImportJson(const ImportFacts& facts) {
  const ImportedBlock& block = facts.placed->block;
  Json json;
  json["tessera_import"] = 1;
  json["source"] = facts.options->source;
  json["format"] = block.format;
  if (!block.version.empty()) json["version"] = block.version;
  TESSERA_ASSIGN_OR_RETURN(json["files"], FilesJson(block.files));
  json["images"] = {{"used", ImagesOf(facts)}, {"in_source", block.images.size()}, {"cameras", block.cameras.size()}};
  json["crs"] = facts.source_crs.empty() ? Json(nullptr) : Json(facts.source_crs);
  json["offset"] = {facts.offset.x(), facts.offset.y(), facts.offset.z()};
  json["frame"] = {{"text", FrameText(facts)}, {"true", facts.placed->true_frame}};
  if (facts.other_frame) {
    json["frame"]["tie_points"] = ResidualsJson(facts.proof->sample);
    json["frame"]["tie_points_in_other_frame"] = ResidualsJson(*facts.other_frame);
  }
  json["conventions"] = block.conventions;
  json["proof"] = Json::parse(ProofToJson(*facts.proof));
  json["proof"]["proven"] = facts.proof->is_proven || (facts.patches && facts.patches->is_proven);
  if (facts.patches) json["proof"]["patches"] = Json::parse(PatchProofToJson(*facts.patches));
  if (facts.mesh) {
    std::vector<std::string> read = facts.mesh_source->files;
    read.insert(read.end(), facts.mesh_source->metadata.begin(), facts.mesh_source->metadata.end());
    TESSERA_ASSIGN_OR_RETURN(Json files, FilesJson(read));
    json["mesh"] = {{"files", std::move(files)},
                    {"coordinates", facts.mesh_place},
                    {"vertices", facts.mesh->vertices},
                    {"faces", facts.mesh->faces},
                    {"welded_vertices", facts.mesh->welded_vertices},
                    {"conventions", facts.mesh_source->conventions},
                    {"left_out", facts.mesh_source->left_out}};
  }
  json["left_out"] = block.left_out;
  json["warnings"] = facts.warnings;
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string ImportText(const ImportFacts& facts) {
  constexpr size_t kWorstImages = 5;
  const ImportedBlock& block = facts.placed->block;
  std::string text;
  const auto row = [&](const char* name, const std::string& value) {
    absl::StrAppendFormat(&text, "%-12s %s\n", name, value);
  };
  row("block",
      absl::StrCat(block.format, block.version.empty() ? "" : " ", block.version, ", ", facts.options->source));
  row("images", absl::StrFormat("%d of %d, %d cameras", ImagesOf(facts), block.images.size(), block.cameras.size()));
  row("coordinates", FrameText(facts));
  if (facts.other_frame) {
    row("", absl::StrCat("tie points here ", ResidualText(facts.proof->sample.median_px), ", in the other frame ",
                         ResidualText(facts.other_frame->median_px)));
  }
  if (facts.mesh) {
    row("mesh", absl::StrFormat("%d faces of %d files, %d vertices welded at borders", facts.mesh->faces,
                                facts.mesh_source->files.size(), facts.mesh->welded_vertices));
  }
  if (!block.left_out.empty()) {
    row("left out", block.left_out.front());
    for (size_t i = 1; i < block.left_out.size(); ++i) row("", block.left_out[i]);
  }
  row("proof", facts.proof->is_proven ? "proven on the tie points"
               : facts.patches        ? PatchProofToText(*facts.patches)
                                      : "not proven: no tie points, and no mesh to compare images through");
  row("scene", facts.out);
  if (facts.proof->sample.observations > 0) absl::StrAppend(&text, "\n", ProofToText(*facts.proof, kWorstImages));
  if (facts.mesh) absl::StrAppend(&text, "\nNext: tessera run ", facts.out, " --out ", facts.out, "-refined\n");
  return text;
}

}  // namespace tessera

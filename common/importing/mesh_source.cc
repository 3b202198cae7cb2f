#include "common/importing/mesh_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <pugixml.hpp>
#include <sstream>
#include <string_view>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "common/base/printable.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kMaxMetadataBytes = 1 << 20;
constexpr int64_t kMaxMetadataTags = 2000;  // bounds the depth; real files have about 10
constexpr std::array<std::string_view, 4> kMeshEndings = {".obj", ".ply", ".glb", ".gltf"};
constexpr char kOdmMesh[] = "odm_textured_model_geo.obj";
constexpr char kOdmOffset[] = "odm_georeferencing_model_geo.txt";

bool HasMeshEnding(const std::string& file) {
  return std::any_of(kMeshEndings.begin(), kMeshEndings.end(),
                     [&](std::string_view ending) { return absl::EndsWithIgnoreCase(file, std::string(ending)); });
}

bool IsGltfFile(const std::string& file) {
  return absl::EndsWithIgnoreCase(file, ".glb") || absl::EndsWithIgnoreCase(file, ".gltf");
}

// A file of a folder: tile "Data/Tile_+001_-002/Tile_+001_-002", and of level 21 the node "3" of its tree.
struct TileFile {
  std::string path;  // relative to the folder
  std::string tile;  // relative to the folder, without the level and the ending
  int64_t level = -1;
  std::string node;
};

TileFile TileFileOf(const std::string& path) {
  TileFile file;
  file.path = path;
  file.tile = path.substr(0, path.rfind('.'));
  const size_t at = file.tile.rfind("_L");
  if (at == std::string::npos || at < file.tile.rfind('/') + 1) return file;
  const std::string_view rest = std::string_view(file.tile).substr(at + 2);
  const size_t end = std::min(rest.find('_'), rest.size());
  int64_t level = 0;
  if (end == 0 || end > 3 || !ParseInteger(rest.substr(0, end), level) || level < 0) return file;
  file.level = level;
  file.node = std::string(rest.substr(std::min(end + 1, rest.size())));
  file.tile.resize(at);
  return file;
}

// Whether `finer` shows a part of what `coarser` shows. ContextCapture names nodes by their path in the tree, one digit
// a level: L20_0 has the children L21_00 to L21_03. Then branches may end at different levels. For other names, the
// finest level replaces all others.
bool ReplacesTile(const TileFile& finer, const TileFile& coarser) {
  if (finer.level <= coarser.level) return false;
  const bool is_path = static_cast<int64_t>(finer.node.size()) - static_cast<int64_t>(coarser.node.size()) ==
                           finer.level - coarser.level &&
                       !coarser.node.empty();
  return !is_path || finer.node.starts_with(coarser.node);
}

// Leaves the finest levels of each tile.
std::vector<TileFile> FinestTiles(const std::vector<TileFile>& files, std::vector<std::string>* left_out) {
  std::map<std::string, std::vector<const TileFile*>> tiles;
  for (const TileFile& file : files) tiles[file.tile].push_back(&file);
  std::vector<TileFile> finest;
  int64_t coarser = 0;
  for (auto& entry : tiles) {
    std::vector<const TileFile*>& levels = entry.second;
    std::stable_sort(levels.begin(), levels.end(),
                     [](const TileFile* a, const TileFile* b) { return a->level < b->level; });
    for (size_t k = 0; k < levels.size(); ++k) {
      const bool replaced = std::any_of(levels.begin() + static_cast<std::ptrdiff_t>(k), levels.end(),
                                        [&](const TileFile* other) { return ReplacesTile(*other, *levels[k]); });
      coarser += replaced;
      if (!replaced) finest.push_back(*levels[k]);
    }
  }
  if (coarser > 0) {
    left_out->push_back(absl::StrCat(coarser, " mesh files of coarser levels of detail (", finest.size(),
                                     " files of the finest levels are read)"));
  }
  return finest;
}

std::string WithoutMeshEnding(const std::string& path) { return path.substr(0, path.rfind('.')); }

Status FindTiles(const std::string& folder, MeshSource* source) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListFiles(folder));
  std::vector<TileFile> meshes;
  for (const std::string& name : names) {
    if (!HasMeshEnding(name)) continue;
    meshes.push_back(TileFileOf(name));
    if (fs::path(name).filename() != kOdmMesh) continue;
    // Beside it OpenDroneMap writes the same mesh in other coordinates.
    if (std::count_if(names.begin(), names.end(), HasMeshEnding) > 1) {
      source->left_out.push_back(absl::StrCat("other meshes than ", Printable(name)));
    }
    meshes = {meshes.back()};
    break;
  }
  if (meshes.empty()) {
    return InputError(folder, "", "no mesh", "a folder with OBJ, PLY, GLB or glTF files, or such a file");
  }
  Faults faults;
  std::map<std::string, std::string> by_name;  // path without ending: path
  for (const TileFile& file : meshes) {
    const auto [other, is_new] = by_name.emplace(WithoutMeshEnding(file.path), file.path);
    if (is_new) continue;
    faults.Add(InputError((fs::path(folder) / file.path).string(), "",
                          absl::StrCat("a second file of the tile, beside ", Quoted(other->second)),
                          "one format: give a folder with files of one format only"));
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  const std::vector<TileFile> finest = FinestTiles(meshes, &source->left_out);
  std::map<std::string, int> uses;  // of names without folder
  for (const TileFile& file : finest) ++uses[fs::path(WithoutMeshEnding(file.path)).filename().string()];
  std::vector<std::pair<std::string, std::string>> tiles;  // name, path
  for (const TileFile& file : finest) {
    const std::string path = WithoutMeshEnding(file.path), name = fs::path(path).filename().string();
    tiles.emplace_back(uses[name] > 1 ? path : name, (fs::path(folder) / file.path).string());
  }
  std::sort(tiles.begin(), tiles.end());
  for (const auto& [name, path] : tiles) {
    source->tile_names.push_back(name);
    source->files.push_back(path);
  }
  return absl::OkStatus();
}

bool ParseOrigin(const std::string& text, Eigen::Vector3d* point) {
  const std::vector<std::string> words = absl::StrSplit(text, ',');
  if (words.size() != 3) return false;
  for (size_t k = 0; k < 3; ++k) {
    double& number = (*point)[static_cast<Eigen::Index>(k)];
    if (!ParseNumber(std::string(absl::StripAsciiWhitespace(words[k])), number) || !std::isfinite(number)) return false;
  }
  return true;
}

std::string OriginText(const Eigen::Vector3d& point) {
  return absl::StrFormat("%.12g, %.12g, %.12g", point.x(), point.y(), point.z());
}

Status ReadModelMetadata(const std::string& path, MeshSource* source) {
  TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxMetadataBytes));
  if (bytes.find("<ModelMetadata") == std::string::npos) {
    source->left_out.push_back(absl::StrCat(Printable(path), ": not the metadata.xml of a ContextCapture mesh"));
    return absl::OkStatus();
  }
  TESSERA_ASSIGN_OR_RETURN(const ModelMetadata metadata, ParseModelMetadata(bytes, path));
  source->metadata.push_back(path);
  source->crs = metadata.crs;
  source->offset = metadata.origin;
  source->conventions.push_back(absl::StrCat("The mesh is in the system ", Quoted(metadata.crs),
                                             " of metadata.xml; its SRSOrigin (", OriginText(metadata.origin),
                                             ") is added to the coordinates of its files."));
  return absl::OkStatus();
}

// OpenDroneMap's file has two lines: "WGS84 UTM 15N" and the offset "EASTING NORTHING". In new versions the mesh is in
// odm_texturing, in older ones also in odm_texturing_25d; the offset is in odm_georeferencing or
// odm_georeferencing_25d.
Status ReadOdmOffset(const std::string& mesh, MeshSource* source) {
  const fs::path folder = fs::path(mesh).parent_path();
  std::string sibling = folder.filename().string();
  const size_t at = sibling.find("texturing");
  if (at != std::string::npos) sibling.replace(at, std::string_view("texturing").size(), "georeferencing");
  for (const fs::path& candidate : {folder.parent_path() / sibling / kOdmOffset,
                                    folder.parent_path() / "odm_georeferencing" / kOdmOffset, folder / kOdmOffset}) {
    if (!FileExists(candidate.string())) continue;
    TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(candidate.string(), kMaxMetadataBytes));
    std::istringstream lines(bytes);
    std::string system, offset, datum, grid, zone, east, north;
    std::getline(lines, system);
    std::getline(lines, offset);
    std::istringstream(system) >> datum >> grid >> zone;
    std::istringstream(offset) >> east >> north;
    int64_t number = 0;
    const bool is_south = zone.ends_with('S');
    if (datum != "WGS84" || grid != "UTM" || (!is_south && !zone.ends_with('N')) ||
        !ParseInteger(std::string_view(zone).substr(0, zone.size() - 1), number) || number < 1 || number > 60) {
      return InputError(candidate.string(), "line 1", Quoted(system), "a system such as 'WGS84 UTM 15N'");
    }
    if (!ParseNumber(east, source->offset.x()) || !ParseNumber(north, source->offset.y()) ||
        !source->offset.allFinite()) {
      return InputError(candidate.string(), "line 2", Quoted(offset), "easting and northing of the offset");
    }
    source->crs = absl::StrCat("EPSG:", (is_south ? 32700 : 32600) + number);
    source->metadata.push_back(candidate.string());
    source->conventions.push_back(absl::StrCat("The mesh is in ", source->crs, " (", system, ") of ", kOdmOffset,
                                               "; its offset (", OriginText(source->offset),
                                               ") is added to the coordinates of the mesh."));
    return absl::OkStatus();
  }
  return InputError(mesh, "", absl::StrCat("no ", kOdmOffset, " in ../odm_georeferencing or beside it"),
                    "this file, which has the offset of the mesh; copy it beside the mesh");
}

}  // namespace

StatusOr<ModelMetadata> ParseModelMetadata(const std::string& bytes, const std::string& name) {
  if (static_cast<int64_t>(bytes.size()) > kMaxMetadataBytes ||
      std::count(bytes.begin(), bytes.end(), '<') > kMaxMetadataTags) {
    return InputError(name, "", absl::StrCat("a file of ", bytes.size(), " bytes"),
                      "the small file metadata.xml that ContextCapture writes beside a mesh");
  }
  if (bytes.find("<!DOCTYPE") != std::string::npos) {
    return InputError(name, "", "a document type", "XML without document type and entities");
  }
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(bytes.data(), bytes.size());
  if (!parsed) {
    return InputError(name, absl::StrCat("byte ", parsed.offset), parsed.description(), "well-formed XML");
  }
  const pugi::xml_node root = document.child("ModelMetadata");
  if (!root) return InputError(name, "/", Quoted(document.document_element().name()), "the element ModelMetadata");
  ModelMetadata metadata;
  metadata.crs = std::string(absl::StripAsciiWhitespace(root.child("SRS").text().get()));
  const std::string origin = root.child("SRSOrigin").text().get();
  if (root.child("SRSOrigin") && !ParseOrigin(origin, &metadata.origin)) {
    return InputError(name, "/ModelMetadata/SRSOrigin", Quoted(origin), "three numbers, as in '691000,5334000,0'");
  }
  return metadata;
}

StatusOr<MeshSource> FindMeshSource(const std::string& given_path) {
  const std::string path = AbsolutePath(given_path);
  MeshSource source;
  std::error_code error;
  const bool is_folder = fs::is_directory(path, error);
  if (is_folder) {
    TESSERA_RETURN_IF_ERROR(FindTiles(path, &source));
  } else if (!FileExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file or folder"));
  } else {
    source.files = {path};
    source.tile_names = {fs::path(path).stem().string()};
  }
  if (std::any_of(source.files.begin(), source.files.end(), IsGltfFile)) {
    source.conventions.push_back("The y axis of glTF files points up: (x, y, z) becomes (x, -z, y).");
  }
  if (source.files.size() == 1 && fs::path(source.files[0]).filename() == kOdmMesh) {
    TESSERA_RETURN_IF_ERROR(ReadOdmOffset(source.files[0], &source));
    return source;
  }
  fs::path folder = is_folder ? fs::path(path) : fs::path(path).parent_path();
  for (int above = 0; above <= 2; ++above, folder = folder.parent_path()) {
    const std::string metadata = (folder / "metadata.xml").string();
    if (!FileExists(metadata)) continue;
    TESSERA_RETURN_IF_ERROR(ReadModelMetadata(metadata, &source));
    break;
  }
  return source;
}

}  // namespace tessera

#include "common/exporting/mesh_files/glb_export.h"

#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/export_map.h"
#include "common/exporting/gltf_conventions.h"
#include "common/exporting/mesh_files/clustered_mesh.h"
#include "common/exporting/mesh_files/welded_vertices.h"
#include "common/storage/files.h"
#include "common/storage/new_file.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr char kGlbName[] = "mesh.glb";

nlohmann::json GlbJson(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

Status ForEachGlbPart(const JoinInput& input, const TaskControl& control,
                      const std::function<Status(size_t, const Sheet&)>& visit) {
  for (size_t i = 0; i < input.sheets.size(); ++i) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(i) / static_cast<double>(input.sheets.size()), "glb");
    TESSERA_ASSIGN_OR_RETURN(const Sheet sheet, ReadSheet(input.sheets[i].part_path));
    TESSERA_RETURN_IF_ERROR(visit(i, sheet));
  }
  return absl::OkStatus();
}

// All parts as one mesh, with welded borders.
StatusOr<Sheet> MergedGlbParts(const JoinInput& input, const TaskControl& control, WeldedVertices* welded) {
  Sheet all;
  TESSERA_RETURN_IF_ERROR(ForEachGlbPart(input, control, [&](size_t i, const Sheet& part) {
    const CityVertices city = welded->Of(i, part);
    for (const uint32_t v : city.new_vertices) {
      all.vertices.push_back(part.vertices[v]);
      if (!part.colors.empty()) all.colors.push_back(part.colors[v]);
    }
    for (const auto& [a, b, c] : part.faces) all.faces.push_back({city.numbers[a], city.numbers[b], city.numbers[c]});
    all.labels.insert(all.labels.end(), part.labels.begin(), part.labels.end());
    return absl::OkStatus();
  }));
  return all;
}

// All parts, simplified to at most `most_triangles`. `area_m2`: of their faces.
StatusOr<Sheet> SimplifiedGlbParts(const JoinInput& input, const TaskControl& control, double area_m2,
                                   int64_t most_triangles) {
  // A plane in general position has about 1.5 occupied cubes, of two triangles each, for the square of a cube's side.
  double cell_m = std::sqrt(3 * area_m2 / static_cast<double>(most_triangles));
  for (;;) {
    ClusteredMesh clustered(cell_m);
    TESSERA_RETURN_IF_ERROR(ForEachGlbPart(input, control, [&](size_t, const Sheet& part) {
      clustered.Add(part);
      return absl::OkStatus();
    }));
    Sheet all = clustered.Take();
    const auto triangles = static_cast<double>(all.faces.size());
    if (triangles <= static_cast<double>(most_triangles)) return all;
    cell_m *= 1.05 * std::sqrt(triangles / static_cast<double>(most_triangles));
  }
}

// What the file's coordinates and colours mean.
StatusOr<nlohmann::json> GlbExtras(const JoinInput& input) {
  const ExportScene& scene = input.scene;
  nlohmann::json extras = {{"axes", "x east, y up, z south, metres"},
                           {"color", std::string(VertexColorName(input.options.color))}};
  TESSERA_ASSIGN_OR_RETURN(const GlobeMap globe, GlobeMap::Open(scene));
  if (globe.on_globe()) {
    TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d geodetic, scene.frame.GeodeticFromLocal(Eigen::Vector3d::Zero()));
    extras["origin"] = {{"latitude_deg", geodetic.x() * 180 / std::numbers::pi},
                        {"longitude_deg", geodetic.y() * 180 / std::numbers::pi},
                        {"height_m", 0}};  // above the WGS 84 ellipsoid
  } else {
    extras["axes"] = "y up, metres; the scene has no place on the globe";
  }
  TESSERA_ASSIGN_OR_RETURN(const ExportMap map, ExportMap::Open(scene, input.options.crs));
  Eigen::Vector3d position = Eigen::Vector3d::Zero(), coordinates = position;
  TESSERA_RETURN_IF_ERROR(globe.EnuFromLocal({&position, 1}));
  TESSERA_RETURN_IF_ERROR(map.FromLocal({&coordinates, 1}));
  extras["crs"] = map.crs();
  extras["reference_point"] = {{"position", GlbJson(GltfFromEnu(position))}, {"coordinates", GlbJson(coordinates)}};
  nlohmann::json legend = nlohmann::json::array();
  for (const LegendEntry& entry : ColorLegend(scene, input.options.color)) {
    legend.push_back({{"name", entry.name}, {"color", entry.color}});
  }
  if (!legend.empty()) extras["legend"] = legend;
  nlohmann::json set_aside = nlohmann::json::array();
  for (const JoinInput::Item& item : input.sheets) {
    if (item.set_aside) set_aside.push_back(SheetName(item.id));
  }
  if (!set_aside.empty()) extras["quarantined_sheets"] = set_aside;
  return extras;
}

class GlbWriter {
 public:
  GlbWriter(const JoinInput& input, const Sheet& mesh) : input_(input), mesh_(mesh) {
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : mesh.vertices) box.extend(p);
    // Whole metres, so that it is exact as a float too.
    if (!box.isEmpty()) centre_ = box.center().array().round();
    positions_.reserve(3 * mesh.vertices.size());
    for (const Eigen::Vector3d& p : mesh.vertices) {
      const Eigen::Vector3f q = GltfFromEnu<double>(p - centre_).cast<float>();
      positions_.insert(positions_.end(), {q.x(), q.y(), q.z()});
    }
    for (size_t f = 0; f < mesh.faces.size(); ++f) faces_of_[mesh.labels[f]].push_back(static_cast<uint32_t>(f));
  }

  Status Write(const std::string& path, nlohmann::json extras) const {
    // Class names are bytes from outside: those that are not UTF-8 are replaced.
    std::string json = Describe(std::move(extras)).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    json.resize((json.size() + 3) / 4 * 4, ' ');
    const uint64_t size = 12 + 8 + json.size() + (bytes() > 0 ? 8 + bytes() : 0);
    if (size > std::numeric_limits<uint32_t>::max()) return absl::ResourceExhaustedError(path + ": more than 4 GiB");
    const std::string temporary = TemporaryBeside(path);
    NewFile file(temporary);
    const auto add = [&file](uint32_t value) { file.Add(&value, sizeof(value)); };
    for (const uint64_t value :
         {uint64_t{kGlbMagic}, uint64_t{2}, size, uint64_t{json.size()}, uint64_t{kGlbJsonChunk}}) {
      add(static_cast<uint32_t>(value));
    }
    file.Add(json);
    if (bytes() > 0) {
      add(static_cast<uint32_t>(bytes()));
      add(kGlbBinaryChunk);
      file.Add(positions_.data(), 4 * positions_.size());
      for (const Rgb& color : mesh_.colors) {
        std::array<uint16_t, 4> linear = {0, 0, 0, 65535};
        for (int c = 0; c < 3; ++c) linear[c] = LinearLight16(color[c]);
        file.Add(linear.data(), sizeof(linear));
      }
      for (const auto& [label, faces] : faces_of_) {
        for (const uint32_t f : faces) file.Add(mesh_.faces[f].data(), sizeof(Triangle));
      }
    }
    TESSERA_RETURN_IF_ERROR(file.Finish());
    const Status renamed = RenameDurably(temporary, path);
    if (!renamed.ok()) unlink(temporary.c_str());
    return renamed;
  }

 private:
  uint64_t bytes() const { return 4 * positions_.size() + 8 * mesh_.colors.size() + 12 * mesh_.faces.size(); }

  nlohmann::json MaterialOf(int32_t label) const {
    const bool is_class = label >= 0 && static_cast<size_t>(label) < input_.scene.classes.size();
    std::array<double, 4> color = {1, 1, 1, 1};
    if (mesh_.colors.empty()) {
      const Rgb rgb = ClassColor(input_.scene, label);
      for (int c = 0; c < 3; ++c) color[c] = LinearLight(rgb[c]);
    }
    nlohmann::json material = {
        {"name", is_class ? input_.scene.classes[label].name : "unlabelled"},
        {"pbrMetallicRoughness", {{"baseColorFactor", color}, {"metallicFactor", 0}, {"roughnessFactor", 1}}},
        {"extras", {{"class", label}}}};
    // Photographs have light and shadow.
    if (input_.options.color == VertexColor::kImage) {
      material["extensions"]["KHR_materials_unlit"] = nlohmann::json::object();
    }
    return material;
  }

  nlohmann::json Describe(nlohmann::json extras) const {
    nlohmann::json gltf = {{"asset", {{"version", "2.0"}, {"generator", "Tessera"}, {"extras", std::move(extras)}}},
                           {"scene", 0},
                           {"scenes", nlohmann::json::array({{{"name", "Tessera"}}})}};
    if (mesh_.faces.empty()) return gltf;
    const size_t vertices = mesh_.vertices.size();
    Eigen::AlignedBox3f box;
    for (size_t v = 0; v < vertices; ++v) box.extend(Eigen::Vector3f::Map(&positions_[3 * v]));
    nlohmann::json views = nlohmann::json::array();
    views.push_back({{"buffer", 0}, {"byteLength", 12 * vertices}, {"target", kGltfArrayBuffer}});
    nlohmann::json accessors = nlohmann::json::array();
    accessors.push_back({{"bufferView", 0},
                         {"componentType", kGltfFloat},
                         {"count", vertices},
                         {"type", "VEC3"},
                         {"min", GlbJson(box.min().cast<double>())},
                         {"max", GlbJson(box.max().cast<double>())}});
    nlohmann::json attributes = {{"POSITION", 0}};
    uint64_t offset = 12 * vertices;
    if (!mesh_.colors.empty()) {
      views.push_back({{"buffer", 0},
                       {"byteOffset", offset},
                       {"byteLength", 8 * vertices},
                       {"byteStride", 8},
                       {"target", kGltfArrayBuffer}});
      accessors.push_back({{"bufferView", 1},
                           {"componentType", kGltfUint16},
                           {"normalized", true},
                           {"count", vertices},
                           {"type", "VEC4"}});
      attributes["COLOR_0"] = 1;
      offset += 8 * vertices;
    }
    const size_t index_view = views.size();
    views.push_back(
        {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", 12 * mesh_.faces.size()}, {"target", kGltfIndexBuffer}});
    nlohmann::json primitives = nlohmann::json::array(), materials = nlohmann::json::array();
    uint64_t index_offset = 0;
    for (const auto& [label, faces] : faces_of_) {
      primitives.push_back(
          {{"attributes", attributes}, {"indices", accessors.size()}, {"material", materials.size()}, {"mode", 4}});
      materials.push_back(MaterialOf(label));
      accessors.push_back({{"bufferView", index_view},
                           {"byteOffset", index_offset},
                           {"componentType", kGltfUint32},
                           {"count", 3 * faces.size()},
                           {"type", "SCALAR"}});
      index_offset += 12 * faces.size();
    }
    if (input_.options.color == VertexColor::kImage) gltf["extensionsUsed"].push_back("KHR_materials_unlit");
    gltf["scenes"][0]["nodes"].push_back(0);
    gltf["nodes"].push_back({{"name", "mesh"}, {"mesh", 0}, {"translation", GlbJson(GltfFromEnu(centre_))}});
    gltf["meshes"].push_back({{"primitives", primitives}});
    gltf["materials"] = materials;
    gltf["accessors"] = accessors;
    gltf["bufferViews"] = views;
    gltf["buffers"].push_back({{"byteLength", bytes()}});
    return gltf;
  }

  const JoinInput& input_;
  const Sheet& mesh_;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
  std::vector<float> positions_;                       // about the centre, y up
  std::map<int32_t, std::vector<uint32_t>> faces_of_;  // by label
};

}  // namespace

StatusOr<std::vector<std::string>> WriteGlbPart(const SheetInput& input, const std::string& folder,
                                                const TaskControl&) {
  TESSERA_ASSIGN_OR_RETURN(const GlobeMap globe, GlobeMap::Open(input.scene));
  Sheet part = input.sheet;
  TESSERA_RETURN_IF_ERROR(globe.EnuFromLocal(part.vertices));
  part.colors.clear();
  if (input.options.color != VertexColor::kClass) {
    part.colors = VertexColors(input.sheet, input.scene, input.options.color);
  }
  part.confidence.clear();
  part.displacement_m.clear();
  TESSERA_RETURN_IF_ERROR(WriteSheet(absl::StrCat(folder, "/", kPartFile), part));
  return std::vector<std::string>();
}

StatusOr<std::vector<std::string>> JoinGlbOf(const JoinInput& input, const std::string& folder,
                                             const TaskControl& control, int64_t most_triangles) {
  TESSERA_ASSIGN_OR_RETURN(nlohmann::json extras, GlbExtras(input));
  int64_t triangles = 0;
  double area_m2 = 0;
  Sheet mesh;
  {
    WeldedVertices welded;
    TESSERA_RETURN_IF_ERROR(ForEachGlbPart(input, PartOf(control, 0, 0.3), [&](size_t, const Sheet& part) {
      triangles += static_cast<int64_t>(part.faces.size());
      for (size_t f = 0; f < part.faces.size(); ++f) area_m2 += FaceArea(part.mesh(), f);
      return triangles > most_triangles ? absl::OkStatus() : welded.Add(part);
    }));
    if (triangles <= most_triangles) {
      TESSERA_ASSIGN_OR_RETURN(mesh, MergedGlbParts(input, PartOf(control, 0.3, 0.9), &welded));
    }
  }
  if (triangles > most_triangles) {
    TESSERA_ASSIGN_OR_RETURN(mesh, SimplifiedGlbParts(input, PartOf(control, 0.3, 0.9), area_m2, most_triangles));
    extras["triangles_before_simplification"] = triangles;
    if (input.warnings != nullptr) {
      input.warnings->push_back(absl::StrCat("glb: simplified from ", triangles, " to ", mesh.faces.size(),
                                             " triangles, because viewers read ", "one file of at most ",
                                             most_triangles, ": 3dtiles, obj and ply have all"));
    }
  }
  TESSERA_RETURN_IF_ERROR(GlbWriter(input, mesh).Write(absl::StrCat(folder, "/", kGlbName), std::move(extras)));
  return std::vector<std::string>{kGlbName};
}

StatusOr<std::vector<std::string>> JoinGlb(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control) {
  return JoinGlbOf(input, folder, control, kMostGlbTriangles);
}

}  // namespace tessera

// Surfaces and labels.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <random>

#include "common/meshio/ply.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/scene_mesh_file.h"
#include "tests/support/bent_scene/text_model.h"

namespace tessera::bent {
namespace {

const Eigen::Vector3d kUtmOffset(386512, 6671850, 20);

Eigen::AlignedBox3d BoxOf(const TriangleMesh& mesh) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : mesh.vertices) box.extend(p);
  return box;
}

void SetUtm(const std::string& scene) {
  SetInSceneJson(scene, "crs", {{"type", "utm"}, {"zone", 35}, {"north", true}});
  SetInSceneJson(scene, "up", nullptr);
}

// Edits the mesh in place.
template <class Edit>
void EditMesh(const std::string& scene, const Edit& edit) {
  TriangleMesh mesh = ReadSceneMesh(scene);
  edit(&mesh);
  WriteSceneMesh(scene, mesh);
}

double MedianOf(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

void AddFace(TriangleMesh* mesh, uint32_t a, uint32_t b, uint32_t c, int32_t label) {
  mesh->faces.push_back({a, b, c});
  mesh->labels.push_back(label);
}

// Gives each group of faces its own vertices. `group`: of each face.
TriangleMesh SplitIntoGroups(const TriangleMesh& mesh, const std::vector<int>& group) {
  TriangleMesh split;
  split.faces = mesh.faces;
  split.labels = mesh.labels;
  std::map<std::pair<int, uint32_t>, uint32_t> copies;
  for (size_t f = 0; f < split.faces.size(); ++f) {
    for (uint32_t& v : split.faces[f]) {
      const auto [it, is_new] = copies.try_emplace({group[f], v}, static_cast<uint32_t>(split.vertices.size()));
      if (is_new) split.vertices.push_back(mesh.vertices[v]);
      v = it->second;
    }
  }
  return split;
}

}  // namespace

TriangleMesh ReadSceneMesh(const std::string& scene) {
  auto content = ReadPly(scene + "/mesh.ply");
  if (!content.ok()) FailBend(std::string(content.status().message()));
  return std::move(content->mesh);
}

void WriteSceneMesh(const std::string& scene, const TriangleMesh& mesh) {
  if (!WritePly(scene + "/mesh.ply", mesh).ok()) FailBend("cannot write the mesh");
}

void DropLikelihoods(const std::string& scene) {
  std::filesystem::remove_all(scene + "/likelihoods");
  SetInSceneJson(scene, "likelihoods", nullptr);
}

void MoreClassesThanNames(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    for (int32_t& label : mesh->labels) label += 2;
  });
}

void SumLabels(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    constexpr int32_t kOther[] = {1, 3, 3, 2};
    for (int32_t& label : mesh->labels) label = kOther[label];
  });
}

void NoLabels(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) { mesh->labels.clear(); });
  DropLikelihoods(scene);
}

void DoubleUtm(const std::string& scene) {
  TransformScene(scene, Eigen::Matrix3d::Identity(), kUtmOffset);
  SetUtm(scene);
}

void OffsetNotApplied(const std::string& scene) {
  const TriangleMesh mesh = ReadSceneMesh(scene);
  TransformScene(scene, Eigen::Matrix3d::Identity(), kUtmOffset);
  WriteSceneMesh(scene, mesh);
}

void VertexAtOrigin(const std::string& scene) {
  DoubleUtm(scene);
  EditMesh(scene, [](TriangleMesh* mesh) { mesh->vertices.at(1000).setZero(); });
}

void MeshInFeet(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    for (Eigen::Vector3d& p : mesh->vertices) p /= 0.3048;
  });
}

void AxesExchanged(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    for (Eigen::Vector3d& p : mesh->vertices) std::swap(p.x(), p.y());
  });
}

void SceneYDown(const std::string& scene) {
  Eigen::Matrix3d turn;
  turn << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  TransformScene(scene, turn, Eigen::Vector3d::Zero());
  SetInSceneJson(scene, "up", nullptr);
}

void SceneZDown(const std::string& scene) {
  Eigen::Matrix3d turn;
  turn << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  TransformScene(scene, turn, Eigen::Vector3d::Zero());
  SetInSceneJson(scene, "up", nullptr);
}

void ScaleHundredth(const std::string& scene) {
  TransformScene(scene, Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(), 0.01);
}

void ScaleThousand(const std::string& scene) {
  TransformScene(scene, Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(), 1000);
}

void TriangleSoup(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    std::vector<int> own_group(mesh->faces.size());
    for (size_t f = 0; f < own_group.size(); ++f) own_group[f] = static_cast<int>(f);
    *mesh = SplitIntoGroups(*mesh, own_group);
  });
}

void TileBorders(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    std::vector<double> middles[2];
    const MeshSpans spans(*mesh);
    for (size_t f = 0; f < mesh->faces.size(); ++f) {
      for (int axis = 0; axis < 2; ++axis) middles[axis].push_back(spans.Centroid(f)[axis]);
    }
    const double x = MedianOf(middles[0]), y = MedianOf(middles[1]);
    std::vector<int> tile;
    for (size_t f = 0; f < mesh->faces.size(); ++f) {
      tile.push_back((middles[0][f] > x ? 2 : 0) + (middles[1][f] > y ? 1 : 0));
    }
    *mesh = SplitIntoGroups(*mesh, tile);
  });
}

void PoissonBubble(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    constexpr uint32_t kSides = 12, kRings = 5;
    const Eigen::AlignedBox3d box = BoxOf(*mesh);
    const Eigen::Vector3d middle = box.center();
    const double radius = 2 * box.diagonal().norm();
    const auto first = static_cast<uint32_t>(mesh->vertices.size());
    for (uint32_t ring = 1; ring <= kRings; ++ring) {
      for (uint32_t k = 0; k < kSides; ++k) {
        const double azimuth = 2 * std::numbers::pi * k / kSides;
        const double elevation = -std::numbers::pi / 2 * ring / (kRings + 1);
        mesh->vertices.push_back(middle + radius * Eigen::Vector3d(std::cos(azimuth) * std::cos(elevation),
                                                                   std::sin(azimuth) * std::cos(elevation),
                                                                   std::sin(elevation)));
      }
    }
    const uint32_t bottom = first + kRings * kSides, corners = bottom + 1;
    mesh->vertices.push_back(middle - Eigen::Vector3d(0, 0, radius));
    const Eigen::Vector3d low = box.min(), high = box.max();
    for (const Eigen::Vector2d& p : {Eigen::Vector2d(high.x(), high.y()), Eigen::Vector2d(low.x(), high.y()),
                                     Eigen::Vector2d(low.x(), low.y()), Eigen::Vector2d(high.x(), low.y())}) {
      mesh->vertices.emplace_back(p.x(), p.y(), low.z());
    }
    const size_t first_face = mesh->faces.size();
    for (uint32_t k = 0; k < kSides; ++k) {
      const uint32_t next = (k + 1) % kSides, side = 4 * k / kSides, next_side = (4 * (k + 1) / kSides) % 4;
      for (uint32_t ring = 0; ring + 1 < kRings; ++ring) {
        const uint32_t p = first + ring * kSides + k, q = first + ring * kSides + next;
        AddFace(mesh, p, q, p + kSides, 0);
        AddFace(mesh, q, q + kSides, p + kSides, 0);
      }
      AddFace(mesh, bottom - kSides + k, bottom - kSides + next, bottom, 0);
      AddFace(mesh, first + k, corners + side, first + next, 0);
      if (next_side != side) AddFace(mesh, first + next, corners + side, corners + next_side, 0);
    }
    // The outside of the bubble faces away from its middle, that of the collar up.
    const MeshSpans spans(*mesh);
    for (size_t f = first_face; f < mesh->faces.size(); ++f) {
      Triangle& face = mesh->faces[f];
      const bool is_collar = *std::max_element(face.begin(), face.end()) >= corners;
      const Eigen::Vector3d normal = FaceCross(spans, f);
      const double outwards = is_collar ? normal.z() : normal.dot(spans.Centroid(f) - middle);
      if (outwards < 0) std::swap(face[1], face[2]);
    }
  });
}

void FloatingBits(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    std::mt19937_64 random(7);
    const Eigen::AlignedBox3d box = BoxOf(*mesh);
    std::uniform_real_distribution<double> share(0, 1);
    std::normal_distribution<double> offset_m(0, 0.3);
    const auto somewhere = [&] {
      Eigen::Vector3d p;
      for (int k = 0; k < 3; ++k) p[k] = box.min()[k] + share(random) * (box.sizes()[k] + (k == 2 ? 5 : 0));
      return p;
    };
    const auto first = static_cast<uint32_t>(mesh->vertices.size());
    const std::vector<Triangle> faces = mesh->faces;
    for (uint32_t i = 0; i < 1500; ++i) {
      const Eigen::Vector3d middle = somewhere();
      for (int k = 0; k < 3; ++k) {
        mesh->vertices.push_back(middle + Eigen::Vector3d(offset_m(random), offset_m(random), offset_m(random)));
      }
      AddFace(mesh, first + 3 * i, first + 3 * i + 1, first + 3 * i + 2, -1);
    }
    for (uint32_t i = 0; i < 300; ++i) AddFace(mesh, faces.at(i)[0], faces[i][1], first + 3 * i, -1);  // fins
    for (size_t i = 0; i < 50; ++i) AddFace(mesh, faces[i][0], faces[i][1], faces[i][2], -1);          // repeated
    for (size_t i = 0; i < 40; ++i) AddFace(mesh, faces[i][0], faces[i][1], faces[i][1], -1);          // no area
    for (int i = 0; i < 100; ++i) mesh->vertices.push_back(somewhere());                               // unused
  });
}

void InsideOut(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    for (Triangle& face : mesh->faces) std::swap(face[0], face[2]);
  });
}

void OneFace(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    const Eigen::AlignedBox3d box = BoxOf(*mesh);
    const Eigen::Vector3d low = box.min(), high = box.max();
    mesh->vertices = {low, {2 * high.x(), low.y(), low.z()}, {low.x(), 2 * high.y(), low.z()}};
    mesh->faces = {{0, 1, 2}};
    mesh->labels = {0};
  });
}

void EmptyMesh(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) {
    mesh->faces.clear();
    mesh->labels.clear();
  });
}

void SpikeOfAKilometre(const std::string& scene) {
  EditMesh(scene, [](TriangleMesh* mesh) { mesh->vertices.at(1000).z() += 1000; });
}

}  // namespace tessera::bent

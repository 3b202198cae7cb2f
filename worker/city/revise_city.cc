#include "worker/city/revise_city.h"

#include <algorithm>
#include <map>
#include <optional>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "worker/city/pick.h"
#include "common/storage/hash.h"
#include "worker/city/view_box.h"
#include "worker/refine/submesh.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr uint32_t kNone = UINT32_MAX;

using Position = std::array<double, 3>;
using Edge = std::array<uint32_t, 2>;  // lower id first

Position PositionOf(const Eigen::Vector3d& p) { return {p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}; }  // maps -0 to 0

Edge EdgeOf(uint32_t a, uint32_t b) { return a < b ? Edge{a, b} : Edge{b, a}; }

// The corner at which comparison starts: equal faces may begin at different corners.
int FirstCorner(const MeshSpans& mesh, size_t face) {
  int first = 0;
  for (int k = 1; k < 3; ++k) {
    if (PositionOf(mesh.Corner(face, k)) < PositionOf(mesh.Corner(face, first))) first = k;
  }
  return first;
}

struct FaceShape {
  std::array<Position, 3> corners;
  int64_t label;
  bool operator==(const FaceShape&) const = default;
};

FaceShape ShapeOf(const MeshSpans& mesh, size_t face) {
  const int first = FirstCorner(mesh, face);
  FaceShape shape = {{}, mesh.labels[face]};
  for (int k = 0; k < 3; ++k) shape.corners[k] = PositionOf(mesh.Corner(face, (first + k) % 3));
  return shape;
}

struct HashedFace {
  uint64_t hash;
  uint32_t face;
  bool operator<(const HashedFace& o) const { return hash != o.hash ? hash < o.hash : face < o.face; }
};

StatusOr<ScratchArray<HashedFace>> HashFaces(const MeshSpans& mesh, const std::string& scratch_folder) {
  TESSERA_ASSIGN_OR_RETURN(auto hashed, ScratchArray<HashedFace>::Create(scratch_folder, mesh.faces.size()));
  ParallelFor(static_cast<int64_t>(mesh.faces.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (auto f = static_cast<size_t>(begin); f < static_cast<size_t>(end); ++f) {
      const FaceShape shape = ShapeOf(mesh, f);
      hashed[f] = {Xxh3(&shape, sizeof(shape)), static_cast<uint32_t>(f)};
    }
  });
  std::sort(hashed.values().begin(), hashed.values().end());
  return hashed;
}

StatusOr<ScratchArray<uint32_t>> Nones(size_t count, const std::string& scratch_folder) {
  TESSERA_ASSIGN_OR_RETURN(auto array, ScratchArray<uint32_t>::Create(scratch_folder, count));
  std::fill(array.values().begin(), array.values().end(), kNone);
  return array;
}

// For each face of `now` the equal face of `base`, or kNone.
StatusOr<ScratchArray<uint32_t>> MatchFaces(const MeshSpans& base, const MeshSpans& now, const std::string& scratch) {
  TESSERA_ASSIGN_OR_RETURN(const auto of_base, HashFaces(base, scratch));
  TESSERA_ASSIGN_OR_RETURN(const auto of_now, HashFaces(now, scratch));
  TESSERA_ASSIGN_OR_RETURN(auto match, Nones(now.faces.size(), scratch));
  size_t begin = 0;
  for (size_t i = 0; i < of_now.size(); ++i) {
    while (begin < of_base.size() && of_base[begin].hash < of_now[i].hash) ++begin;
    // Repaired meshes have no duplicate faces.
    for (size_t j = begin; j < of_base.size() && of_base[j].hash == of_now[i].hash; ++j) {
      if (ShapeOf(base, of_base[j].face) == ShapeOf(now, of_now[i].face)) match[of_now[i].face] = of_base[j].face;
    }
  }
  return match;
}

// Drops matches whose vertices do not correspond one to one over all incident faces. Where fans of faces were joined
// or separated, equal corners are different vertices, and keeping their ids would join what the new mesh separates.
Status DropInconsistentMatches(const MeshSpans& base, const MeshSpans& now, const std::string& scratch,
                               ScratchArray<uint32_t>* match) {
  TESSERA_ASSIGN_OR_RETURN(auto to_base, Nones(now.vertices.size(), scratch));
  TESSERA_ASSIGN_OR_RETURN(auto to_now, Nones(base.vertices.size(), scratch));
  TESSERA_ASSIGN_OR_RETURN(auto inconsistent, ScratchArray<uint8_t>::Create(scratch, now.vertices.size()));
  TESSERA_ASSIGN_OR_RETURN(auto inconsistent_of_base, ScratchArray<uint8_t>::Create(scratch, base.vertices.size()));
  const auto for_corners = [&](const auto& visit) {
    for (size_t f = 0; f < now.faces.size(); ++f) {
      const uint32_t g = (*match)[f];
      if (g == kNone) continue;
      const int first = FirstCorner(now, f), first_of_base = FirstCorner(base, g);
      for (int k = 0; k < 3; ++k) visit(f, now.faces[f][(first + k) % 3], base.faces[g][(first_of_base + k) % 3]);
    }
  };
  for_corners([&](size_t, uint32_t v, uint32_t w) {
    if (to_base[v] == kNone) to_base[v] = w;
    if (to_now[w] == kNone) to_now[w] = v;
    inconsistent[v] |= to_base[v] != w;
    inconsistent_of_base[w] |= to_now[w] != v;
  });
  std::vector<size_t> dropped;
  for_corners([&](size_t f, uint32_t v, uint32_t w) {
    if (inconsistent[v] || inconsistent_of_base[w]) dropped.push_back(f);
  });
  for (const size_t f : dropped) (*match)[f] = kNone;
  return absl::OkStatus();
}

// A kept face next to new faces.
struct BorderFace {
  size_t face;                         // index in `now`
  std::map<Position, uint32_t> id_of;  // ids of the city's vertices on it
};

class Reviser {
 public:
  Reviser(const CityReader& city, const DiskMesh& base, const DiskMesh& now, const GroundPlane& ground,
          const std::string& scratch)
      : city_(city), base_(base), now_(now), mesh_(now.spans()), ground_(ground), scratch_(scratch) {}

  Status Match() {
    TESSERA_ASSIGN_OR_RETURN(match_, MatchFaces(base_.spans(), mesh_, scratch_));
    TESSERA_RETURN_IF_ERROR(DropInconsistentMatches(base_.spans(), mesh_, scratch_, &match_));
    uint32_t end = 0;  // of face indices of the base's file
    for (size_t g = 0; g < base_.faces.size(); ++g) end = std::max(end, FileFace(base_, g) + 1);
    TESSERA_ASSIGN_OR_RETURN(now_of_file_, Nones(end, scratch_));
    TESSERA_ASSIGN_OR_RETURN(auto touches_new_face, ScratchArray<uint8_t>::Create(scratch_, mesh_.vertices.size()));
    std::vector<uint32_t> new_faces;
    for (size_t f = 0; f < mesh_.faces.size(); ++f) {
      if (match_[f] != kNone) {
        now_of_file_[FileFace(base_, match_[f])] = FileFace(now_, f);
        continue;
      }
      new_faces.push_back(static_cast<uint32_t>(f));
      for (const uint32_t v : mesh_.faces[f]) touches_new_face[v] = 1;
    }
    for (size_t f = 0; f < mesh_.faces.size(); ++f) {
      const Triangle& face = mesh_.faces[f];
      if (match_[f] != kNone && (touches_new_face[face[0]] || touches_new_face[face[1]] || touches_new_face[face[2]])) {
        border_faces_[FileFace(base_, match_[f])].face = f;
      }
    }
    SetNewFaces(std::move(new_faces));
    return absl::OkStatus();
  }

  // Finds the faces and vertices of the city that are kept.
  Status FindKeptFaces(const TaskControl& control) {
    TESSERA_ASSIGN_OR_RETURN(new_index_of_vertex_, Nones(static_cast<size_t>(city_.vertex_ids_end()), scratch_));
    TESSERA_ASSIGN_OR_RETURN(new_index_of_face_, Nones(static_cast<size_t>(city_.face_ids_end()), scratch_));
    TESSERA_ASSIGN_OR_RETURN(auto seen, ScratchArray<uint8_t>::Create(scratch_, now_of_file_.size()));
    TESSERA_RETURN_IF_ERROR(ForEachFace(control, [&](const CityBlock& block, size_t f) {
      if (!IsKept(block, f)) {
        AddChanged(block.mesh.Centroid(f));
        return;
      }
      const Triangle face = block.GlobalFace(f);
      seen[block.input_face[f]] = 1;
      new_index_of_face_[block.face_ids[f]] = 0;
      for (const uint32_t v : face) new_index_of_vertex_[v] = 0;
      if (const auto border = border_faces_.find(block.input_face[f]); border != border_faces_.end()) {
        for (int k = 0; k < 3; ++k) border->second.id_of.emplace(PositionOf(block.mesh.Corner(f, k)), face[k]);
      }
    }));
    for (size_t file_face = 0; file_face < seen.size(); ++file_face) {
      if (now_of_file_[file_face] != kNone && !seen[file_face]) return NotASplit(static_cast<uint32_t>(file_face));
    }
    const auto number = [](ScratchArray<uint32_t>* indices) {
      uint32_t next = 0;
      for (uint32_t& index : indices->values()) {
        if (index != kNone) index = next++;
      }
      return next;
    };
    kept_vertices_ = number(&new_index_of_vertex_);
    kept_faces_ = number(&new_index_of_face_);
    return absl::OkStatus();
  }

  // Splits the new faces. Edges shared with kept faces are split as those are.
  Status Split(const std::vector<PosedCamera>& cameras, DensityOptions density) {
    ids_.assign(part_.vertices.size(), kNone);
    for (const auto& [file_face, border] : border_faces_) {
      std::array<uint32_t, 3> id;
      for (int k = 0; k < 3; ++k) {
        const auto known = border.id_of.find(PositionOf(mesh_.Corner(border.face, k)));
        if (known == border.id_of.end()) {
          return NotASplit(file_face);
        }
        id[k] = known->second;
        const size_t at = IndexInPart(mesh_.faces[border.face][k]);
        if (at < part_ids_.size()) ids_[at] = id[k];
      }
      for (int k = 0; k < 3; ++k) {
        const int next = (k + 1) % 3;
        AddSplits(border, id[k], id[next], mesh_.Corner(border.face, k), mesh_.Corner(border.face, next));
      }
    }
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : part_.vertices) box.extend(p);
    std::vector<PosedCamera> on_part;
    std::copy_if(cameras.begin(), cameras.end(), std::back_inserter(on_part),
                 [&](const PosedCamera& camera) { return MayShow(camera, box); });
    // One round at a time: the ids of an edge's ends must be known to look up its midpoint.
    const auto middle_of = [&](uint32_t a, uint32_t b) {
      return ids_[a] == kNone || ids_[b] == kNone ? middle_of_.end() : middle_of_.find(EdgeOf(ids_[a], ids_[b]));
    };
    for (const uint32_t f : new_faces_) input_face_.push_back(FileFace(now_, f));
    // Kept faces may have been split twice: their edges may be halved more often than those that the cameras decide.
    const int decided_rounds = std::exchange(density.max_rounds, 1);
    for (int round = 0;; ++round) {
      SplitMesh split = SplitLargeFaces(part_, on_part, density, [&](uint32_t a, uint32_t b) {
        const auto known = middle_of(a, b);
        if (known != middle_of_.end()) return std::optional<bool>(known->second != kNone);
        return round < decided_rounds ? std::optional<bool>() : std::optional<bool>(false);
      });
      if (split.halved_edges.empty()) break;
      for (const auto& [a, b] : split.halved_edges) {
        const auto known = middle_of(a, b);
        ids_.push_back(known == middle_of_.end() ? kNone : known->second);
      }
      input_face_ = Pick(input_face_, split.parent_face);
      part_ = std::move(split.mesh);
    }
    return absl::OkStatus();
  }

  StatusOr<RevisedCity> Compose(const TaskControl& control) {
    // Indices of the part's vertices: kept ones have theirs, new ones follow all kept vertices.
    std::vector<uint32_t> index;
    size_t vertices = kept_vertices_;
    for (const uint32_t id : ids_) {
      index.push_back(id == kNone ? static_cast<uint32_t>(vertices++) : new_index_of_vertex_[id]);
    }
    const size_t faces = kept_faces_ + part_.faces.size(), new_vertices = vertices - kept_vertices_;
    RevisedCity out;
    out.vertex_ids_end = city_.vertex_ids_end() + static_cast<int64_t>(new_vertices);
    out.face_ids_end = city_.face_ids_end() + static_cast<int64_t>(part_.faces.size());
    if (out.vertex_ids_end >= kNone || out.face_ids_end >= kNone) {
      return absl::ResourceExhaustedError(
          "updates of this mesh have used up all face or vertex ids (32 bits): run a new job without a base");
    }
    out.kept_faces = static_cast<int64_t>(kept_faces_);
    TESSERA_ASSIGN_OR_RETURN(out.mesh.vertices, ScratchArray<Eigen::Vector3d>::Create(scratch_, vertices));
    TESSERA_ASSIGN_OR_RETURN(out.mesh.faces, ScratchArray<Triangle>::Create(scratch_, faces));
    TESSERA_ASSIGN_OR_RETURN(out.mesh.labels, ScratchArray<int32_t>::Create(scratch_, faces));
    TESSERA_ASSIGN_OR_RETURN(out.mesh.input_face, ScratchArray<uint32_t>::Create(scratch_, faces));
    TESSERA_ASSIGN_OR_RETURN(out.vertex_ids, ScratchArray<uint32_t>::Create(scratch_, vertices));
    TESSERA_ASSIGN_OR_RETURN(out.face_ids, ScratchArray<uint32_t>::Create(scratch_, faces));
    TESSERA_RETURN_IF_ERROR(ForEachFace(control, [&](const CityBlock& block, size_t f) {
      if (!IsKept(block, f)) return;
      const size_t at = new_index_of_face_[block.face_ids[f]];
      const Triangle face = block.GlobalFace(f);
      for (int k = 0; k < 3; ++k) {
        const uint32_t v = new_index_of_vertex_[face[k]];
        out.mesh.vertices[v] = block.mesh.Corner(f, k);
        out.vertex_ids[v] = face[k];
        out.mesh.faces[at][k] = v;
      }
      out.mesh.labels[at] = block.mesh.labels[f];
      out.mesh.input_face[at] = now_of_file_[block.input_face[f]];
      out.face_ids[at] = block.face_ids[f];
    }));
    for (size_t v = 0; v < index.size(); ++v) {
      if (ids_[v] != kNone) continue;
      out.mesh.vertices[index[v]] = part_.vertices[v];
      out.vertex_ids[index[v]] = static_cast<uint32_t>(city_.vertex_ids_end() + index[v] - kept_vertices_);
    }
    for (size_t f = 0; f < part_.faces.size(); ++f) {
      const size_t at = kept_faces_ + f;
      for (int k = 0; k < 3; ++k) out.mesh.faces[at][k] = index[part_.faces[f][k]];
      out.mesh.labels[at] = part_.labels[f];
      out.mesh.input_face[at] = input_face_[f];
      out.face_ids[at] = static_cast<uint32_t>(city_.face_ids_end() + static_cast<int64_t>(f));
      AddChanged(out.mesh.spans().Centroid(at));
    }
    out.changed_cells = std::move(changed_cells_);
    return out;
  }

 private:
  static uint32_t FileFace(const DiskMesh& mesh, size_t face) {
    return mesh.input_face.size() > 0 ? mesh.input_face[face] : static_cast<uint32_t>(face);
  }

  static Status NotASplit(uint32_t file_face) {
    return absl::DataLossError(absl::StrCat("the base job's city is not a split of its mesh: face ", file_face,
                                            " of the mesh, or one of its corners, is missing from the city"));
  }

  void SetNewFaces(std::vector<uint32_t> new_faces) {
    new_faces_ = std::move(new_faces);
    Submesh part = ExtractFaces(mesh_, new_faces_);
    part_ = std::move(part.mesh);
    part_ids_ = std::move(part.vertices);
  }

  // Returns part_ids_.size() if the vertex is not in the part.
  size_t IndexInPart(uint32_t vertex) const {
    const auto it = std::lower_bound(part_ids_.begin(), part_ids_.end(), vertex);
    return it == part_ids_.end() || *it != vertex ? part_ids_.size() : static_cast<size_t>(it - part_ids_.begin());
  }

  // Records how a kept face splits its edge from a to b.
  void AddSplits(const BorderFace& border, uint32_t a, uint32_t b, const Eigen::Vector3d& at_a,
                 const Eigen::Vector3d& at_b) {
    const Eigen::Vector3d middle = 0.5 * (at_a + at_b);
    const auto id = border.id_of.find(PositionOf(middle));
    const bool halved = id != border.id_of.end() && id->second != a && id->second != b;
    middle_of_[EdgeOf(a, b)] = halved ? id->second : kNone;
    if (!halved) return;
    AddSplits(border, a, id->second, at_a, middle);
    AddSplits(border, id->second, b, middle, at_b);
  }

  bool IsKept(const CityBlock& block, size_t face) const {
    const uint32_t of_file = block.input_face[face];
    return of_file < now_of_file_.size() && now_of_file_[of_file] != kNone;
  }

  void AddChanged(const Eigen::Vector3d& centroid) {
    const Eigen::Vector2i at = ground_.Cell(centroid);
    changed_cells_.insert({at.x(), at.y()});
  }

  template <class Visit>
  Status ForEachFace(const TaskControl& control, const Visit& visit) const {
    for (size_t b = 0; b < city_.block_count(); ++b) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city_.Block(b));
      for (size_t f = 0; f < block.face_ids.size(); ++f) visit(block, f);
    }
    return absl::OkStatus();
  }

  const CityReader& city_;
  const DiskMesh &base_, &now_;
  const MeshSpans mesh_;  // of now_
  const GroundPlane& ground_;
  const std::string& scratch_;
  ScratchArray<uint32_t> match_;                           // for each face of `now`: the matching face of the base
  ScratchArray<uint32_t> now_of_file_;                     // face of the base's file -> face of the new file
  std::unordered_map<uint32_t, BorderFace> border_faces_;  // by face of the base's file
  std::vector<uint32_t> new_faces_;                        // faces of `now` without a match
  std::vector<uint32_t> part_ids_;                         // vertices of these faces in `now`, ascending
  TriangleMesh part_;                                      // these faces as a mesh; later split
  std::vector<uint32_t> ids_;                              // city ids of the part's vertices; kNone: new
  std::vector<uint32_t> input_face_;                       // of the part's faces, in the file
  std::map<Edge, uint32_t> middle_of_;                     // midpoints of border edges, by city ids; kNone: not split
  ScratchArray<uint32_t> new_index_of_vertex_, new_index_of_face_;  // by id, of kept ones
  size_t kept_vertices_ = 0, kept_faces_ = 0;
  std::set<std::array<int, 2>> changed_cells_;
};

}  // namespace

StatusOr<RevisedCity> ReviseCity(const CityReader& city, const DiskMesh& base, const DiskMesh& now,
                                 const GroundPlane& ground, const std::vector<PosedCamera>& cameras,
                                 const DensityOptions& density, const std::string& scratch_folder,
                                 const TaskControl& control) {
  Reviser reviser(city, base, now, ground, scratch_folder);
  TESSERA_RETURN_IF_ERROR(reviser.Match());
  TESSERA_RETURN_IF_ERROR(reviser.FindKeptFaces(control));
  TESSERA_RETURN_IF_ERROR(reviser.Split(cameras, density));
  return reviser.Compose(control);
}

}  // namespace tessera

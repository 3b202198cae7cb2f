#include "worker/city/revise_city.h"

#include <algorithm>
#include <map>
#include <optional>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/base/pick.h"
#include "common/storage/hash.h"
#include "worker/city/view_box.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr uint32_t kNone = UINT32_MAX;

using Position = std::array<double, 3>;
using Edge = std::array<uint32_t, 2>;  // the lower id first

Position PositionOf(const Eigen::Vector3d& p) { return {p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}; }  // -0 is 0

Edge EdgeOf(uint32_t a, uint32_t b) { return a < b ? Edge{a, b} : Edge{b, a}; }

// The corner that comes first when two faces are compared: equal faces may begin at different corners.
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

// Of each face of `now`, that of `base` which it is.
StatusOr<ScratchArray<uint32_t>> MatchFaces(const MeshSpans& base, const MeshSpans& now, const std::string& scratch) {
  TESSERA_ASSIGN_OR_RETURN(const auto of_base, HashFaces(base, scratch));
  TESSERA_ASSIGN_OR_RETURN(const auto of_now, HashFaces(now, scratch));
  TESSERA_ASSIGN_OR_RETURN(auto match, Nones(now.faces.size(), scratch));
  size_t begin = 0;
  for (size_t i = 0; i < of_now.size(); ++i) {
    while (begin < of_base.size() && of_base[begin].hash < of_now[i].hash) ++begin;
    // Repaired meshes have no face twice.
    for (size_t j = begin; j < of_base.size() && of_base[j].hash == of_now[i].hash; ++j) {
      if (ShapeOf(base, of_base[j].face) == ShapeOf(now, of_now[i].face)) match[of_now[i].face] = of_base[j].face;
    }
  }
  return match;
}

// Faces match only if their vertices are the same ones too, each of one mesh one of the other, over all faces about
// them: where fans of faces came together or apart, the faces about the vertex are others.
Status DropMisfits(const MeshSpans& base, const MeshSpans& now, const std::string& scratch,
                   ScratchArray<uint32_t>* match) {
  TESSERA_ASSIGN_OR_RETURN(auto to_base, Nones(now.vertices.size(), scratch));
  TESSERA_ASSIGN_OR_RETURN(auto to_now, Nones(base.vertices.size(), scratch));
  TESSERA_ASSIGN_OR_RETURN(auto misfit, ScratchArray<uint8_t>::Create(scratch, now.vertices.size()));
  TESSERA_ASSIGN_OR_RETURN(auto misfit_of_base, ScratchArray<uint8_t>::Create(scratch, base.vertices.size()));
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
    misfit[v] |= to_base[v] != w;
    misfit_of_base[w] |= to_now[w] != v;
  });
  std::vector<size_t> dropped;
  for_corners([&](size_t f, uint32_t v, uint32_t w) {
    if (misfit[v] || misfit_of_base[w]) dropped.push_back(f);
  });
  for (const size_t f : dropped) (*match)[f] = kNone;
  return absl::OkStatus();
}

// A face that stays, beside faces that are new.
struct RimFace {
  size_t face;                         // of `now`
  std::map<Position, uint32_t> id_of;  // of the city's vertices that it is split at
};

class Reviser {
 public:
  Reviser(const CityReader& city, const DiskMesh& base, const DiskMesh& now, const GroundPlane& ground,
          const std::string& scratch)
      : city_(city), base_(base), now_(now), mesh_(now.spans()), ground_(ground), scratch_(scratch) {}

  Status Match() {
    TESSERA_ASSIGN_OR_RETURN(match_, MatchFaces(base_.spans(), mesh_, scratch_));
    TESSERA_RETURN_IF_ERROR(DropMisfits(base_.spans(), mesh_, scratch_, &match_));
    uint32_t end = 0;  // of faces of the base's file
    for (size_t g = 0; g < base_.faces.size(); ++g) end = std::max(end, FileFace(base_, g) + 1);
    TESSERA_ASSIGN_OR_RETURN(now_of_file_, Nones(end, scratch_));
    TESSERA_ASSIGN_OR_RETURN(auto is_fresh, ScratchArray<uint8_t>::Create(scratch_, mesh_.vertices.size()));
    std::vector<size_t> fresh;
    for (size_t f = 0; f < mesh_.faces.size(); ++f) {
      if (match_[f] != kNone) {
        now_of_file_[FileFace(base_, match_[f])] = FileFace(now_, f);
        continue;
      }
      fresh.push_back(f);
      for (const uint32_t v : mesh_.faces[f]) is_fresh[v] = 1;
    }
    for (size_t f = 0; f < mesh_.faces.size(); ++f) {
      const Triangle& face = mesh_.faces[f];
      if (match_[f] != kNone && (is_fresh[face[0]] || is_fresh[face[1]] || is_fresh[face[2]])) {
        rim_[FileFace(base_, match_[f])].face = f;
      }
    }
    TakeFresh(fresh);
    return absl::OkStatus();
  }

  // What of the city stays.
  Status FindWhatStays(const TaskControl& control) {
    TESSERA_ASSIGN_OR_RETURN(place_of_vertex_, Nones(static_cast<size_t>(city_.vertex_ids_end()), scratch_));
    TESSERA_ASSIGN_OR_RETURN(place_of_face_, Nones(static_cast<size_t>(city_.face_ids_end()), scratch_));
    TESSERA_ASSIGN_OR_RETURN(auto seen, ScratchArray<uint8_t>::Create(scratch_, now_of_file_.size()));
    TESSERA_RETURN_IF_ERROR(ForEachFace(control, [&](const CityBlock& block, size_t f) {
      if (!Stays(block, f)) {
        AddChanged(block.mesh.Centroid(f));
        return;
      }
      const Triangle face = block.GlobalFace(f);
      seen[block.input_face[f]] = 1;
      place_of_face_[block.face_ids[f]] = 0;
      for (const uint32_t v : face) place_of_vertex_[v] = 0;
      if (const auto rim = rim_.find(block.input_face[f]); rim != rim_.end()) {
        for (int k = 0; k < 3; ++k) rim->second.id_of.emplace(PositionOf(block.mesh.Corner(f, k)), face[k]);
      }
    }));
    for (size_t file_face = 0; file_face < seen.size(); ++file_face) {
      if (now_of_file_[file_face] != kNone && !seen[file_face]) return NoSplit(static_cast<uint32_t>(file_face));
    }
    const auto number = [](ScratchArray<uint32_t>* places) {
      uint32_t next = 0;
      for (uint32_t& place : places->values()) {
        if (place != kNone) place = next++;
      }
      return next;
    };
    kept_vertices_ = number(&place_of_vertex_);
    kept_faces_ = number(&place_of_face_);
    return absl::OkStatus();
  }

  // The new faces, split as those that stay beside them are.
  Status Split(const std::vector<PosedCamera>& cameras, DensityOptions density) {
    ids_.assign(part_.vertices.size(), kNone);
    for (const auto& [file_face, rim] : rim_) {
      std::array<uint32_t, 3> id;
      for (int k = 0; k < 3; ++k) {
        const auto known = rim.id_of.find(PositionOf(mesh_.Corner(rim.face, k)));
        if (known == rim.id_of.end()) {
          return NoSplit(file_face);
        }
        id[k] = known->second;
        const size_t at = PlaceInPart(mesh_.faces[rim.face][k]);
        if (at < part_ids_.size()) ids_[at] = id[k];
      }
      for (int k = 0; k < 3; ++k) {
        const int next = (k + 1) % 3;
        AddSplits(rim, id[k], id[next], mesh_.Corner(rim.face, k), mesh_.Corner(rim.face, next));
      }
    }
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : part_.vertices) box.extend(p);
    std::vector<PosedCamera> on_part;
    std::copy_if(cameras.begin(), cameras.end(), std::back_inserter(on_part),
                 [&](const PosedCamera& camera) { return MayShow(camera, box); });
    // A round at a time, so that the ids of the ends are known.
    const auto middle_of = [&](uint32_t a, uint32_t b) {
      return ids_[a] == kNone || ids_[b] == kNone ? middle_of_.end() : middle_of_.find(EdgeOf(ids_[a], ids_[b]));
    };
    for (const size_t f : fresh_) input_face_.push_back(FileFace(now_, f));
    for (int round = std::exchange(density.max_rounds, 1); round > 0; --round) {
      SplitMesh split = SplitLargeFaces(part_, on_part, density, [&](uint32_t a, uint32_t b) {
        const auto known = middle_of(a, b);
        return known == middle_of_.end() ? std::optional<bool>() : std::optional<bool>(known->second != kNone);
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
    // Places of the part's vertices: of those that stay, theirs; the others behind all that stay.
    std::vector<uint32_t> place;
    size_t vertices = kept_vertices_;
    for (const uint32_t id : ids_) {
      place.push_back(id == kNone ? static_cast<uint32_t>(vertices++) : place_of_vertex_[id]);
    }
    const size_t faces = kept_faces_ + part_.faces.size(), new_vertices = vertices - kept_vertices_;
    RevisedCity out;
    out.vertex_ids_end = city_.vertex_ids_end() + static_cast<int64_t>(new_vertices);
    out.face_ids_end = city_.face_ids_end() + static_cast<int64_t>(part_.faces.size());
    if (out.vertex_ids_end >= kNone || out.face_ids_end >= kNone) {
      return absl::ResourceExhaustedError("the mesh changed so often that its ids are used up: run it without a base");
    }
    out.kept_faces = static_cast<int64_t>(kept_faces_);
    TESSERA_ASSIGN_OR_RETURN(out.mesh.vertices, ScratchArray<Eigen::Vector3d>::Create(scratch_, vertices));
    TESSERA_ASSIGN_OR_RETURN(out.mesh.faces, ScratchArray<Triangle>::Create(scratch_, faces));
    TESSERA_ASSIGN_OR_RETURN(out.mesh.labels, ScratchArray<int32_t>::Create(scratch_, faces));
    TESSERA_ASSIGN_OR_RETURN(out.mesh.input_face, ScratchArray<uint32_t>::Create(scratch_, faces));
    TESSERA_ASSIGN_OR_RETURN(out.vertex_ids, ScratchArray<uint32_t>::Create(scratch_, vertices));
    TESSERA_ASSIGN_OR_RETURN(out.face_ids, ScratchArray<uint32_t>::Create(scratch_, faces));
    TESSERA_RETURN_IF_ERROR(ForEachFace(control, [&](const CityBlock& block, size_t f) {
      if (!Stays(block, f)) return;
      const size_t at = place_of_face_[block.face_ids[f]];
      const Triangle face = block.GlobalFace(f);
      for (int k = 0; k < 3; ++k) {
        const uint32_t v = place_of_vertex_[face[k]];
        out.mesh.vertices[v] = block.mesh.Corner(f, k);
        out.vertex_ids[v] = face[k];
        out.mesh.faces[at][k] = v;
      }
      out.mesh.labels[at] = block.mesh.labels[f];
      out.mesh.input_face[at] = now_of_file_[block.input_face[f]];
      out.face_ids[at] = block.face_ids[f];
    }));
    for (size_t v = 0; v < place.size(); ++v) {
      if (ids_[v] != kNone) continue;
      out.mesh.vertices[place[v]] = part_.vertices[v];
      out.vertex_ids[place[v]] = static_cast<uint32_t>(city_.vertex_ids_end() + place[v] - kept_vertices_);
    }
    for (size_t f = 0; f < part_.faces.size(); ++f) {
      const size_t at = kept_faces_ + f;
      for (int k = 0; k < 3; ++k) out.mesh.faces[at][k] = place[part_.faces[f][k]];
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

  static Status NoSplit(uint32_t file_face) {
    return absl::DataLossError(absl::StrCat("the base's city is no split of its mesh: face ", file_face,
                                            " of the mesh, or a corner of it, is in no face of the city"));
  }

  void TakeFresh(const std::vector<size_t>& fresh) {
    fresh_ = fresh;
    for (const size_t f : fresh) part_ids_.insert(part_ids_.end(), mesh_.faces[f].begin(), mesh_.faces[f].end());
    std::sort(part_ids_.begin(), part_ids_.end());
    part_ids_.erase(std::unique(part_ids_.begin(), part_ids_.end()), part_ids_.end());
    for (const uint32_t v : part_ids_) part_.vertices.push_back(mesh_.vertices[v]);
    for (const size_t f : fresh) {
      Triangle& face = part_.faces.emplace_back();
      for (int k = 0; k < 3; ++k) face[k] = static_cast<uint32_t>(PlaceInPart(mesh_.faces[f][k]));
      part_.labels.push_back(mesh_.labels[f]);
    }
  }

  // The number of the part's vertices if it is none of them.
  size_t PlaceInPart(uint32_t vertex) const {
    const auto it = std::lower_bound(part_ids_.begin(), part_ids_.end(), vertex);
    return it == part_ids_.end() || *it != vertex ? part_ids_.size() : static_cast<size_t>(it - part_ids_.begin());
  }

  // How a face that stays splits its edge from a to b.
  void AddSplits(const RimFace& rim, uint32_t a, uint32_t b, const Eigen::Vector3d& at_a, const Eigen::Vector3d& at_b) {
    const Eigen::Vector3d middle = 0.5 * (at_a + at_b);
    const auto id = rim.id_of.find(PositionOf(middle));
    const bool halved = id != rim.id_of.end() && id->second != a && id->second != b;
    middle_of_[EdgeOf(a, b)] = halved ? id->second : kNone;
    if (!halved) return;
    AddSplits(rim, a, id->second, at_a, middle);
    AddSplits(rim, id->second, b, middle, at_b);
  }

  bool Stays(const CityBlock& block, size_t face) const {
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
  ScratchArray<uint32_t> match_;                            // face of the base that each face of `now` is
  ScratchArray<uint32_t> now_of_file_;                      // of faces of the base's file: those of the new file
  std::unordered_map<uint32_t, RimFace> rim_;               // by face of the base's file
  std::vector<size_t> fresh_;                               // faces of `now` that are new
  std::vector<uint32_t> part_ids_;                          // vertices of `now` that these have, ascending
  TriangleMesh part_;                                       // these as a mesh of their own; later split
  std::vector<uint32_t> ids_;                               // of the part's vertices, in the city; kNone: new
  std::vector<uint32_t> input_face_;                        // of the part's faces, in the file
  std::map<Edge, uint32_t> middle_of_;                      // of edges of the rim, by ids in the city; kNone: whole
  ScratchArray<uint32_t> place_of_vertex_, place_of_face_;  // by id, of what stays
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
  TESSERA_RETURN_IF_ERROR(reviser.FindWhatStays(control));
  TESSERA_RETURN_IF_ERROR(reviser.Split(cameras, density));
  return reviser.Compose(control);
}

}  // namespace tessera

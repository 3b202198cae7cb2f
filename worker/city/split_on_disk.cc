#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "common/base/parallel.h"
#include "worker/city/disk_mesh.h"
#include "worker/city/id_merge.h"
#include "worker/city/view_box.h"
#include "worker/refine/submesh.h"

namespace tessera {
namespace {

constexpr int64_t kPartsGrain = 1024;

// Ranges of a chunk's data in the scratch files.
struct Chunk {
  size_t id_begin = 0;  // vertices of the chunk: those of the mesh, then the new ones
  size_t old_vertices = 0;
  size_t edge_begin = 0;  // new vertices
  std::vector<size_t> round_ends;
  size_t face_begin = 0, face_end = 0;
  size_t new_vertices(size_t round) const {
    return round_ends.size() > round ? round_ends[round] - RoundBegin(round) : 0;
  }
  size_t RoundBegin(size_t round) const { return round == 0 ? 0 : round_ends[std::min(round, round_ends.size()) - 1]; }
};

std::vector<PosedCamera> CamerasOn(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : mesh.vertices) box.extend(p);
  std::vector<PosedCamera> on_mesh;
  for (const PosedCamera& camera : cameras) {
    if (MayShow(camera, box)) on_mesh.push_back(camera);
  }
  return on_mesh;
}

// The faces [begin, end), without labels.
Submesh Extract(MeshSpans mesh, size_t begin, size_t end) {
  mesh.labels = {};
  std::vector<uint32_t> faces(end - begin);
  std::iota(faces.begin(), faces.end(), static_cast<uint32_t>(begin));
  return ExtractFaces(mesh, faces);
}

// Upper estimate of the number of parts of each face: the longest edge is halved until it is short enough.
std::vector<double> PredictParts(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                 const DensityOptions& density) {
  const double limit_px2 = density.max_footprint_px2 * 4 / std::sqrt(3.0);
  std::vector<double> parts(mesh.faces.size(), 1);
  ParallelForEach(parts.size(), kPartsGrain, [&](int64_t f) {
    double longest_px2 = 0;
    for (const PosedCamera& camera : cameras) {
      std::array<Eigen::Vector3d, 3> p;
      for (int k = 0; k < 3; ++k) p[k] = camera.Project(mesh.Corner(f, k));
      for (int k = 0; k < 3; ++k) {
        if (!camera.InImage(p[k]) || !camera.InImage(p[(k + 1) % 3])) continue;
        longest_px2 = std::max(longest_px2, (p[k] - p[(k + 1) % 3]).head<2>().squaredNorm());
      }
    }
    if (longest_px2 > limit_px2) {
      const double rounds = std::ceil(0.5 * std::log2(longest_px2 / limit_px2));
      parts[f] = std::exp2(2 * std::min<double>(rounds, density.max_rounds));
    }
  });
  return parts;
}

class Splitter {
 public:
  static StatusOr<Splitter> Create(const DiskMesh& mesh, const std::string& scratch_folder) {
    TESSERA_ASSIGN_OR_RETURN(auto ids, ScratchList<uint32_t>::Create(scratch_folder));
    TESSERA_ASSIGN_OR_RETURN(auto edges, ScratchList<Edge>::Create(scratch_folder));
    TESSERA_ASSIGN_OR_RETURN(auto middles, ScratchList<Eigen::Vector3d>::Create(scratch_folder));
    TESSERA_ASSIGN_OR_RETURN(auto middle_starts, ScratchList<Eigen::Vector3d>::Create(scratch_folder));
    TESSERA_ASSIGN_OR_RETURN(auto faces, ScratchList<Triangle>::Create(scratch_folder));
    TESSERA_ASSIGN_OR_RETURN(auto parents, ScratchList<uint32_t>::Create(scratch_folder));
    return Splitter(mesh, scratch_folder, std::move(ids), std::move(edges), std::move(middles),
                    std::move(middle_starts), std::move(faces), std::move(parents));
  }

  // Splits the faces from `begin` on, given as mesh `part`.
  void SplitChunk(size_t begin, const Submesh& part, const std::vector<PosedCamera>& cameras,
                  const DensityOptions& density) {
    const SplitMesh split = SplitLargeFaces(part.mesh, cameras, density);
    const std::vector<uint32_t>& vertex_ids = part.vertices;
    Chunk& chunk = chunks_.emplace_back();
    chunk.id_begin = ids_.size();
    chunk.old_vertices = vertex_ids.size();
    chunk.edge_begin = edges_.size();
    chunk.round_ends = split.round_ends;
    chunk.face_begin = faces_.size();
    ids_.Append(std::span<const uint32_t>(vertex_ids));
    for (size_t i = 0; i < split.halved_edges.size(); ++i) {
      ids_.Append(0u);  // set by Assemble
      edges_.Append(split.halved_edges[i]);
      middles_.Append(split.mesh.vertices[vertex_ids.size() + i]);
    }
    AppendStarts(vertex_ids, split.halved_edges);
    faces_.Append(std::span<const Triangle>(split.mesh.faces));
    for (const uint32_t parent : split.parent_face) parents_.Append(static_cast<uint32_t>(begin + parent));
    chunk.face_end = faces_.size();
  }

  size_t new_vertices() const { return edges_.size(); }

  // Assigns global ids to the new vertices in the order in which SplitLargeFaces creates them: by round, then by the
  // ids of the edge's ends. Two chunks that split a shared edge produce equal keys, which merge into one vertex.
  // Within a chunk the order is already right, since local indices ascend with the ids.
  StatusOr<DiskMesh> Assemble() {
    const DiskMesh& mesh = mesh_;
    TESSERA_ASSIGN_OR_RETURN(auto ids, ids_.Finish());
    TESSERA_ASSIGN_OR_RETURN(const auto edges, edges_.Finish());
    TESSERA_ASSIGN_OR_RETURN(const auto middles, middles_.Finish());
    TESSERA_ASSIGN_OR_RETURN(const auto middle_starts, middle_starts_.Finish());
    TESSERA_ASSIGN_OR_RETURN(auto vertices, ScratchList<Eigen::Vector3d>::Create(scratch_folder_));
    TESSERA_ASSIGN_OR_RETURN(auto starts, ScratchList<Eigen::Vector3d>::Create(scratch_folder_));
    vertices.Append(mesh.vertices.values());
    starts.Append(mesh.starts.values());
    size_t rounds = 0;
    for (const Chunk& chunk : chunks_) rounds = std::max(rounds, chunk.round_ends.size());
    for (size_t round = 0; round < rounds; ++round) {
      TESSERA_ASSIGN_OR_RETURN(auto key_list, ScratchList<uint64_t>::Create(scratch_folder_));
      for (const Chunk& chunk : chunks_) {
        for (size_t i = 0; i < chunk.new_vertices(round); ++i) {
          const Edge& edge = edges[chunk.edge_begin + chunk.RoundBegin(round) + i];
          key_list.Append(uint64_t{ids[chunk.id_begin + edge[0]]} << 32 | ids[chunk.id_begin + edge[1]]);
        }
      }
      TESSERA_ASSIGN_OR_RETURN(const auto keys, key_list.Finish());
      std::vector<std::span<const uint64_t>> lists;
      size_t begin = 0;
      for (const Chunk& chunk : chunks_) {
        lists.push_back(keys.values().subspan(begin, chunk.new_vertices(round)));
        begin += chunk.new_vertices(round);
      }
      bool any = false;
      uint64_t last = 0;
      for (IdMerge<uint64_t> merge(std::move(lists)); !merge.AtEnd(); merge.Advance()) {
        const Chunk& chunk = chunks_[merge.list()];
        const size_t at = chunk.RoundBegin(round) + merge.index();
        if (!any || merge.key() != last) {
          if (vertices.size() > UINT32_MAX - 1)
            return absl::ResourceExhaustedError(
                "splitting large faces: more than 2^32 - 2 vertices; use a smaller scene or a coarser GSD");
          vertices.Append(middles[chunk.edge_begin + at]);
          if (mesh.starts.size() > 0) starts.Append(middle_starts[chunk.edge_begin + at]);
        }
        any = true;
        last = merge.key();
        ids[chunk.id_begin + chunk.old_vertices + at] = static_cast<uint32_t>(vertices.size() - 1);
      }
    }
    DiskMesh out;
    out.float_positions = mesh.float_positions;
    out.largest_coordinate_m = mesh.largest_coordinate_m;
    TESSERA_ASSIGN_OR_RETURN(out.vertices, vertices.Finish());
    TESSERA_ASSIGN_OR_RETURN(out.starts, starts.Finish());
    TESSERA_ASSIGN_OR_RETURN(out.faces, faces_.Finish());
    TESSERA_ASSIGN_OR_RETURN(out.input_face, parents_.Finish());
    if (out.faces.size() > UINT32_MAX)
      return absl::ResourceExhaustedError(
          "splitting large faces: more than 2^32 - 1 faces; use a smaller scene or a coarser GSD");
    for (const Chunk& chunk : chunks_) {
      for (size_t f = chunk.face_begin; f < chunk.face_end; ++f) {
        for (uint32_t& v : out.faces[f]) v = ids[chunk.id_begin + v];
      }
    }
    if (mesh.labels.size() > 0) {
      TESSERA_ASSIGN_OR_RETURN(out.labels, ScratchArray<int32_t>::Create(scratch_folder_, out.faces.size()));
    }
    for (size_t f = 0; f < out.faces.size(); ++f) {
      uint32_t& parent = out.input_face[f];
      if (mesh.labels.size() > 0) out.labels[f] = mesh.labels[parent];
      if (mesh.input_face.size() > 0) parent = mesh.input_face[parent];
    }
    return out;
  }

 private:
  using Edge = std::array<uint32_t, 2>;
  Splitter(const DiskMesh& mesh, std::string scratch_folder, ScratchList<uint32_t> ids, ScratchList<Edge> edges,
           ScratchList<Eigen::Vector3d> middles, ScratchList<Eigen::Vector3d> middle_starts,
           ScratchList<Triangle> faces, ScratchList<uint32_t> parents)
      : mesh_(mesh),
        scratch_folder_(std::move(scratch_folder)),
        ids_(std::move(ids)),
        edges_(std::move(edges)),
        middles_(std::move(middles)),
        middle_starts_(std::move(middle_starts)),
        faces_(std::move(faces)),
        parents_(std::move(parents)) {}

  // Starts of a chunk's new vertices.
  void AppendStarts(const std::vector<uint32_t>& vertex_ids, const std::vector<Edge>& halved_edges) {
    if (mesh_.starts.size() == 0) return;
    std::vector<Eigen::Vector3d> starts;
    starts.reserve(vertex_ids.size() + halved_edges.size());
    for (const uint32_t id : vertex_ids) starts.push_back(mesh_.starts[id]);
    for (const auto& [a, b] : halved_edges) {
      const Eigen::Vector3d middle = 0.5 * (starts[a] + starts[b]);
      starts.push_back(middle);
      middle_starts_.Append(middle);
    }
  }

  const DiskMesh& mesh_;
  std::string scratch_folder_;
  std::vector<Chunk> chunks_;
  ScratchList<uint32_t> ids_;             // global ids of the chunks' vertices
  ScratchList<Edge> edges_;               // in the chunk's local indices
  ScratchList<Eigen::Vector3d> middles_, middle_starts_;  // midpoints of the edges; of their starts
  ScratchList<Triangle> faces_;           // in the chunk's local indices
  ScratchList<uint32_t> parents_;         // face of the mesh from which each face was split
};

}  // namespace

void CountSplitFaces(const MeshSpans& mesh, const std::vector<PosedCamera>& cameras, const DensityOptions& density,
                     const DiskPassOptions& options, const GroundPlane& ground, std::vector<SurveyCell>* cells) {
  std::map<std::pair<int, int>, int64_t> counts;
  for (size_t begin = 0; begin < mesh.faces.size(); begin += options.faces_per_chunk) {
    const size_t end = std::min(begin + options.faces_per_chunk, mesh.faces.size());
    const Submesh part = Extract(mesh, begin, end);
    const SplitMesh split = SplitLargeFaces(part.mesh, CamerasOn(part.mesh, cameras), density);
    for (const uint32_t parent : split.parent_face) {
      const Eigen::Vector2i at = ground.Cell(mesh.Centroid(begin + parent));
      ++counts[{at.x(), at.y()}];
    }
  }
  for (SurveyCell& cell : *cells) cell.fine_faces = counts[{cell.x, cell.y}];
}

StatusOr<DiskMesh> SplitOnDisk(DiskMesh mesh, const std::vector<PosedCamera>& cameras, const DensityOptions& density,
                               const std::string& scratch_folder, const DiskPassOptions& options,
                               const std::function<Status(double)>& progress) {
  const MeshSpans spans = mesh.spans();
  TESSERA_ASSIGN_OR_RETURN(Splitter splitter, Splitter::Create(mesh, scratch_folder));
  for (size_t begin = 0; begin < spans.faces.size(); begin += options.faces_per_chunk) {
    TESSERA_RETURN_IF_ERROR(progress(static_cast<double>(begin) / static_cast<double>(spans.faces.size())));
    const size_t end = std::min(begin + options.faces_per_chunk, spans.faces.size());
    Submesh part = Extract(spans, begin, end);
    const std::vector<PosedCamera> on_part = CamerasOn(part.mesh, cameras);
    const std::vector<double> parts = PredictParts(part.mesh, on_part, density);
    // As many faces as the predicted number of parts allows.
    size_t from = begin;
    double predicted = 0;
    for (size_t f = begin; f < end; ++f) {
      if (predicted > 0 && predicted + parts[f - begin] > options.split_faces_per_chunk) {
        splitter.SplitChunk(from, Extract(spans, from, f), on_part, density);
        from = f;
        predicted = 0;
      }
      predicted += parts[f - begin];
    }
    splitter.SplitChunk(from, from == begin ? std::move(part) : Extract(spans, from, end), on_part, density);
  }
  if (splitter.new_vertices() == 0) return mesh;
  return splitter.Assemble();
}

}  // namespace tessera

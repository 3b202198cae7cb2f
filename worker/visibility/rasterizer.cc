#include "worker/visibility/rasterizer.h"

#include <algorithm>
#include <array>
#include <mutex>
#include <utility>

#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "worker/visibility/raster_kernel.h"
#include "worker/visibility/unbounded_face.h"

namespace tessera {
namespace {

constexpr int64_t kVertexGrain = 4096;
constexpr int64_t kFaceChunk = 4096;  // the list of selected faces stays in the L1 cache
constexpr int64_t kListBlock = 64;
constexpr int kBandRows = 32;

// A mesh and how it is drawn into a map.
struct Layer {
  const TriangleMesh& mesh;
  const GridVertex* vertices;
  const std::vector<std::array<uint32_t, 2>>& faces;  // ranges
  const CameraWindow& window;
  const FaceSelection& selection;
  double near_m;

  int64_t Select(int64_t first, int64_t last, uint32_t* list) const {
    return SelectFaces(mesh.faces.data(), first, last, vertices, window.rect.width(), window.rect.height(), list);
  }

  void Draw(const uint32_t* list, int64_t count, const DrawTarget& target) const {
    for (int64_t k = 0; k < count; ++k) {
      k += DrawFaces(mesh.faces.data(), list + k, count - k, vertices, target);
      if (k == count) break;
      DrawUnboundedFace(mesh, list[k], vertices, window.camera, near_m, target);
    }
  }
};

// Rows that a block of listed faces may cover, half-open.
struct RowRange {
  int first = 0, last = 0;
};

RowRange RowsOf(const Layer& layer, const uint32_t* list, int64_t count) {
  const int height = layer.window.rect.height();
  int32_t low = std::numeric_limits<int32_t>::max(), high = std::numeric_limits<int32_t>::min();
  for (int64_t k = 0; k < count; ++k) {
    for (uint32_t v : layer.mesh.faces[list[k]]) {
      if (layer.vertices[v].off_grid != 0) return {0, height};
      low = std::min(low, layer.vertices[v].y);
      high = std::max(high, layer.vertices[v].y);
    }
  }
  return {std::clamp((low >> kGridBits) - 1, 0, height), std::clamp((high >> kGridBits) + 1, 0, height)};
}

}  // namespace

struct Rasterizer::Workspace {
  std::vector<GridVertex> vertices;
  std::vector<uint32_t> list;
  std::vector<int64_t> selected;  // selected faces per chunk
  std::vector<RowRange> rows;     // per block of the list

  static void Resize(const PixelRect& rect, FaceMap* map) {
    map->width = rect.width();
    map->height = rect.height();
    map->x0 = rect.x0;
    map->y0 = rect.y0;
    const size_t pixels = static_cast<size_t>(map->width) * map->height;
    map->face.resize(pixels);
    map->depth.resize(pixels);
  }

  // Before rows are drawn. `depth` holds 1/z until TakeDepths.
  static void Clear(int row_first, int row_last, FaceMap* map) {
    const ptrdiff_t first = static_cast<ptrdiff_t>(row_first) * map->width,
                    last = static_cast<ptrdiff_t>(row_last) * map->width;
    std::fill(map->face.begin() + first, map->face.begin() + last, -1);
    std::fill(map->depth.begin() + first, map->depth.begin() + last, 0.0f);
  }

  static void TakeDepths(int row_first, int row_last, FaceMap* map) {
    float* depth = map->depth.data();
    const size_t last = static_cast<size_t>(row_last) * map->width;
    for (size_t i = static_cast<size_t>(row_first) * map->width; i < last; ++i) depth[i] = 1 / depth[i];  // 0: kNothing
  }

  static DrawTarget Target(const Layer& layer, FaceMap* map, int row_first, int row_last) {
    return {map->width, map->height,      map->x0,           map->y0,        row_first,
            row_last,   map->face.data(), map->depth.data(), layer.selection};
  }

  // One thread: draws each chunk's faces while they are in the cache.
  void DrawLayer(const Layer& layer, FaceMap* map) {
    list.resize(std::max<size_t>(list.size(), kFaceChunk));
    Clear(0, map->height, map);
    const DrawTarget target = Target(layer, map, 0, map->height);
    for (const auto& [begin, end] : layer.faces) {
      for (int64_t first = begin; first < end; first += kFaceChunk) {
        const int64_t last = std::min<int64_t>(end, first + kFaceChunk);
        layer.Draw(list.data(), layer.Select(first, last, list.data()), target);
      }
    }
    TakeDepths(0, map->height, map);
  }

  // Many threads: select faces chunk by chunk, then draw band by band.
  void DrawLayerInBands(const Layer& layer, int threads, FaceMap* map) {
    constexpr int64_t kBlocks = kFaceChunk / kListBlock;
    std::vector<std::array<int64_t, 2>> chunk_faces;
    for (const auto& [begin, end] : layer.faces) {
      for (int64_t first = begin; first < end; first += kFaceChunk) {
        chunk_faces.push_back({first, std::min<int64_t>(end, first + kFaceChunk)});
      }
    }
    const int64_t chunks = static_cast<int64_t>(chunk_faces.size());
    list.resize(std::max<size_t>(list.size(), chunks * kFaceChunk));
    selected.resize(std::max<size_t>(selected.size(), chunks));
    rows.resize(std::max<size_t>(rows.size(), chunks * kBlocks));
    ParallelForEach(chunks, 1, [&](int64_t chunk) {
      const int64_t begin = chunk * kFaceChunk;
      uint32_t* mine = list.data() + begin;
      const int64_t count = layer.Select(chunk_faces[chunk][0], chunk_faces[chunk][1], mine);
      selected[chunk] = count;
      for (int64_t k = 0; k < count; k += kListBlock) {
        rows[(begin + k) / kListBlock] = RowsOf(layer, mine + k, std::min(kListBlock, count - k));
      }
    });
    // Few bands: each band sets up again all blocks of faces that reach it.
    const int64_t band_rows = std::max<int64_t>(kBandRows, map->height / (2 * threads) + 1);
    ParallelFor(map->height, band_rows, [&](int64_t row_first, int64_t row_last) {
      Clear(static_cast<int>(row_first), static_cast<int>(row_last), map);
      const DrawTarget target = Target(layer, map, static_cast<int>(row_first), static_cast<int>(row_last));
      for (int64_t chunk = 0; chunk < chunks; ++chunk) {
        const int64_t begin = chunk * kFaceChunk, count = selected[chunk];
        for (int64_t k = 0; k < count; k += kListBlock) {
          const RowRange& range = rows[(begin + k) / kListBlock];
          if (range.first >= row_last || range.last <= row_first) continue;
          layer.Draw(list.data() + begin + k, std::min(kListBlock, count - k), target);
        }
      }
      TakeDepths(static_cast<int>(row_first), static_cast<int>(row_last), map);
    });
  }

  void Project(const TriangleMesh& mesh, const MeshPart& part, const CameraWindow& window, double near_m,
               bool in_parallel) {
    vertices.resize(std::max(vertices.size(), mesh.vertices.size()));
    const auto project = [&](int64_t begin, int64_t end) {
      ProjectToGrid(mesh.vertices.data() + begin, end - begin, window, near_m, vertices.data() + begin);
    };
    if (in_parallel) return ForRanges(part.vertices, kVertexGrain, project);
    for (const auto& [first, last] : part.vertices) project(first, last);
  }

  // `threads`: that this view is divided among.
  void Draw(const TriangleMesh& mesh, const MeshPart& part, const CameraWindow& window, const FaceSelection& selection,
            double near_m, int threads, FaceMap* map) {
    Resize(window.rect, map);
    Project(mesh, part, window, near_m, threads > 1);
    const Layer layer{mesh, vertices.data(), part.faces, window, selection, near_m};
    if (threads > 1) {
      DrawLayerInBands(layer, threads, map);
    } else {
      DrawLayer(layer, map);
    }
  }
};

// Idle workspaces. Grows to the largest number of threads that have drawn at the same time.
struct Rasterizer::Pool {
  std::mutex mutex;
  std::vector<std::unique_ptr<Workspace>> idle;

  std::unique_ptr<Workspace> Take() {
    const std::lock_guard lock(mutex);
    if (idle.empty()) return std::make_unique<Workspace>();
    std::unique_ptr<Workspace> out = std::move(idle.back());
    idle.pop_back();
    return out;
  }
  void Return(std::unique_ptr<Workspace> workspace) {
    const std::lock_guard lock(mutex);
    idle.push_back(std::move(workspace));
  }
};

Rasterizer::Rasterizer() : pool_(std::make_unique<Pool>()) {}
Rasterizer::~Rasterizer() = default;
Rasterizer::Rasterizer(Rasterizer&&) noexcept = default;
Rasterizer& Rasterizer::operator=(Rasterizer&&) noexcept = default;

void Rasterizer::DrawPart(const TriangleMesh& mesh, const MeshPart& part, const CameraWindow& window, FaceMap* map,
                          double near_m, const FaceSelection& selection, int threads) {
  std::unique_ptr<Workspace> workspace = pool_->Take();
  workspace->Draw(mesh, part, window, selection, near_m, threads, map);
  pool_->Return(std::move(workspace));
}

size_t Rasterizer::MostAtOnce(const TriangleMesh& mesh) const {
  const auto most_bytes = static_cast<size_t>(LookaheadLimit_bytes(ThreadCount()));
  return std::max<size_t>(1, most_bytes / (sizeof(GridVertex) * std::max<size_t>(1, mesh.vertices.size())));
}

void CropFaceMap(const FaceMap& map, const PixelRect& rect, FaceMap* out) {
  out->x0 = rect.x0;
  out->y0 = rect.y0;
  out->width = rect.width();
  out->height = rect.height();
  out->face.clear();
  out->depth.clear();
  for (int y = rect.y0; y < rect.y1; ++y) {
    const ptrdiff_t begin = static_cast<ptrdiff_t>(y - map.y0) * map.width + (rect.x0 - map.x0);
    out->face.insert(out->face.end(), map.face.begin() + begin, map.face.begin() + begin + out->width);
    out->depth.insert(out->depth.end(), map.depth.begin() + begin, map.depth.begin() + begin + out->width);
  }
}

}  // namespace tessera

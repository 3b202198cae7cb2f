#include "worker/photo/face_sums.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <span>

#include "common/base/parallel.h"

namespace tessera {

using Eigen::Vector3d;

namespace {

constexpr int64_t kVertexGrain = 8192;
// What belongs to the faces of a strip is scattered in memory. It is prefetched this many faces ahead.
constexpr int kFar = 16, kNear = 8;
constexpr size_t kPieceParts = 1024;  // that are added by one thread

void Add(const FaceSums& part, float pixels, FaceSums* total) {
  for (int c = 0; c < 3; ++c) {
    total->gradient[c] += part.gradient[c];
    total->curvature[c] += part.curvature[c];
  }
  total->pairs += part.pairs / pixels;
}

}  // namespace

void FaceSlots::Begin(size_t faces) {
  ++strip;
  for (const uint32_t page : seen) pages[page] = kNoPage;
  seen.clear();
  pages.resize(std::max(pages.size(), (faces >> kPageBits) + 1), kNoPage);
  found.clear();
}

uint32_t FaceSlots::AddPage(size_t page) {
  pages[page] = static_cast<uint32_t>(seen.size() << kPageBits);
  seen.push_back(static_cast<uint32_t>(page));
  slots.resize(std::max(slots.size(), seen.size() << kPageBits), 0);
  return pages[page];
}

void FaceGatherer::Begin(const TriangleMesh& mesh, const MeshPart& part, const PosedCamera& camera, const FaceMap& map,
                         const std::vector<uint8_t>& own, int strips, StripSums when, std::vector<FaceSums>* sums) {
  mesh_ = &mesh;
  camera_ = &camera;
  map_ = &map;
  own_ = &own;
  when_ = when;
  sums_ = sums;
  waiting_.resize(strips);
  shared_.resize(strips);
  corners_.resize(mesh.vertices.size());
  ForRanges(part.vertices, kVertexGrain, [&](int64_t begin, int64_t end) {
    ProjectToImage(mesh.vertices.data() + begin, end - begin, camera, kNearPlane_m, corners_.data() + begin);
  });
}

void FaceGatherer::SkipStrip(int strip) {
  waiting_[strip].clear();
  shared_[strip].clear();
}

void FaceGatherer::UnboundedToCorners(const FaceMoments& m, FaceSums* out) const {
  const Vector3d centre = camera_->Centre();
  const Vector3d a = mesh_->Corner(m.face, 0) - centre, b = mesh_->Corner(m.face, 1) - centre,
                 c = mesh_->Corner(m.face, 2) - centre;
  // z r = Σ φ_k V_k, so φ = z V⁻¹ r; the rows of V⁻¹ are cross products of the columns of V.
  const Vector3d rows[3] = {b.cross(c), c.cross(a), a.cross(b)};
  const double determinant = a.dot(rows[0]);
  if (determinant == 0) return;
  const PinholeCamera& k = camera_->intrinsics;
  const double rx = (map_->x0 + m.x + 0.5 - k.cx) / k.fx, ry = (map_->y0 + m.y + 0.5 - k.cy) / k.fy;
  const double scale = 1 / determinant;
  const auto ray_sum = [&](double one, double x, double y) -> Vector3d {
    return camera_->rotation_cam_from_world.transpose() *
           Vector3d(scale * (rx * one + x / k.fx), scale * (ry * one + y / k.fy), scale * one);
  };
  const Vector3d g = ray_sum(m.sums[0], m.moments[0], m.moments[2]), h = ray_sum(m.sums[1], m.moments[1], m.moments[3]);
  for (int i = 0; i < 3; ++i) {
    out->gradient[i] = static_cast<float>(rows[i].dot(g));
    out->curvature[i] = static_cast<float>(rows[i].dot(h));
  }
}

FaceGatherer::Part FaceGatherer::ToCorners(const FaceMoments& m) const {
  Part part;
  part.face = m.face;
  part.pixels = m.sums[3];
  part.sums.pairs = m.sums[2];
  if (m.sums[1] == 0) return part;
  const Triangle& face = mesh_->faces[m.face];
  const ImageVertex* corners[3] = {&corners_[face[0]], &corners_[face[1]], &corners_[face[2]]};
  if (corners[0]->inverse_z == 0 || corners[1]->inverse_z == 0 || corners[2]->inverse_z == 0) {
    UnboundedToCorners(m, &part.sums);
    return part;
  }
  // Relative to the centre of the first pixel, in pixels.
  const double x0 = map_->x0 + m.x + 0.5, y0 = map_->y0 + m.y + 0.5;
  double x[3], y[3];
  for (int c = 0; c < 3; ++c) {
    x[c] = corners[c]->x - x0;
    y[c] = corners[c]->y - y0;
  }
  // φ_k = z λ_k / z_k, where λ_k is the part of the image of the face between the pixel and the edge opposite k.
  double area[3], per_column[3], per_row[3];
  for (int k = 0; k < 3; ++k) {
    const int p = (k + 1) % 3, q = (k + 2) % 3;
    area[k] = x[p] * y[q] - y[p] * x[q];
    per_column[k] = y[p] - y[q];
    per_row[k] = x[q] - x[p];
  }
  const double total = area[0] + area[1] + area[2];
  if (total == 0) return part;
  const double scale = 1 / total;
  for (int k = 0; k < 3; ++k) {
    const double weight = scale * corners[k]->inverse_z;
    const double one = weight * area[k], column = weight * per_column[k], row = weight * per_row[k];
    part.sums.gradient[k] = static_cast<float>(one * m.sums[0] + column * m.moments[0] + row * m.moments[2]);
    part.sums.curvature[k] = static_cast<float>(one * m.sums[1] + column * m.moments[1] + row * m.moments[3]);
  }
  return part;
}

bool FaceGatherer::IsWithin(int32_t face, int row_begin, int row_end) const {
  // The rasteriser moves corners by less than the half pixel to the centres of the next rows.
  const double first = map_->y0 + row_begin, last = map_->y0 + row_end;
  const Triangle& corners = mesh_->faces[face];
  return std::all_of(corners.begin(), corners.end(), [&](uint32_t v) {
    const ImageVertex& corner = corners_[v];
    return corner.inverse_z != 0 && corner.y >= first && corner.y <= last;
  });
}

template <bool kAll>
void FaceGatherer::AddRow(const ReferenceStrip& planes, int y, FaceSlots* buffers) const {
  const int width = map_->width;
  const int32_t* faces = map_->face.data() + static_cast<size_t>(y) * width;
  std::vector<FaceMoments>& found = buffers->found;
  int32_t *columns = buffers->columns.data(), *indices = buffers->indices.data(),
          *first_columns = buffers->first_columns.data();
  // Branch-free: whether a pixel sees the face of the one before is unpredictable.
  int count = 0;
  for (int x = 0; x < width; ++x) {
    const int32_t face = faces[x];
    bool wanted = face >= 0;
    if constexpr (!kAll) wanted = wanted && (*own_)[face] != 0;
    const uint32_t slot = buffers->SlotOf(wanted ? face : -1);
    __builtin_prefetch(&buffers->slots[slot], 1);
    columns[count] = x;
    indices[count] = static_cast<int32_t>(slot);
    count += wanted;
  }
  const uint64_t strip = static_cast<uint64_t>(buffers->strip) << 32;
  uint64_t* slots = buffers->slots.data();
  const size_t known = found.size();
  size_t size = known;
  for (int i = 0; i < count; ++i) {
    uint64_t& entry = slots[indices[i]];
    const bool is_new = (entry ^ strip) >> 32 != 0;
    const uint64_t index = is_new ? size : entry & 0xffffffffu;
    entry = strip | index;
    indices[i] = static_cast<int32_t>(index);
    first_columns[size - known] = columns[i];
    size += is_new;
  }
  found.resize(size);
  for (size_t i = known; i < size; ++i) {
    FaceMoments& moments = found[i];
    const int x = first_columns[i - known];
    const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
    moments.first_pixel = FaceMoments::Lanes{fx, fx, fy, fy};
    moments.face = faces[x];
    moments.x = x;
    moments.y = y;
  }
  const float *gradient = planes.gradient.row(y), *curvature = planes.curvature.row(y), *pairs = planes.count.row(y),
              *depth = planes.depth.row(y);
  const auto fy = static_cast<float>(y);
  for (int i = 0; i < count; ++i) {
    const int x = columns[i];
    FaceMoments& moments = found[indices[i]];
    const float g = gradient[x] * depth[x], h = curvature[x] * depth[x];
    const auto fx = static_cast<float>(x);
    moments.sums += FaceMoments::Lanes{g, h, pairs[x], 1};
    moments.moments += FaceMoments::Lanes{g, h, g, h} * (FaceMoments::Lanes{fx, fx, fy, fy} - moments.first_pixel);
  }
}

void FaceGatherer::AddStrip(int strip, const ReferenceStrip& planes, FaceSlots* buffers) {
  buffers->Begin(mesh_->faces.size());
  for (std::vector<int32_t>* row : {&buffers->columns, &buffers->indices, &buffers->first_columns}) {
    row->resize(static_cast<size_t>(map_->width) + 1);
  }
  for (int y = planes.row_begin; y < planes.row_end; ++y) {
    if (own_->empty()) {
      AddRow<true>(planes, y, buffers);
    } else {
      AddRow<false>(planes, y, buffers);
    }
  }
  std::vector<Part>&waiting = waiting_[strip], &shared = shared_[strip];
  waiting.clear();
  shared.clear();
  const bool at_once = when_ == StripSums::kAtOnce;
  const std::vector<FaceMoments>& found = buffers->found;
  for (size_t i = 0; i < found.size(); ++i) {
    if (i + kFar < found.size()) {
      const int32_t face = found[i + kFar].face;
      __builtin_prefetch(&mesh_->faces[face]);
      if (at_once) PrefetchSums(face);
    }
    if (i + kNear < found.size()) {
      for (const uint32_t v : mesh_->faces[found[i + kNear].face]) __builtin_prefetch(&corners_[v]);
    }
    const Part part = ToCorners(found[i]);
    if (!IsWithin(part.face, planes.row_begin, planes.row_end)) {
      shared.push_back(part);
    } else if (at_once) {
      Add(part.sums, part.pixels, &(*sums_)[part.face]);
    } else {
      waiting.push_back(part);
    }
  }
}

void FaceGatherer::JoinStrips() {
  joined_.clear();
  for (const std::vector<Part>& of_strip : shared_) joined_.insert(joined_.end(), of_strip.begin(), of_strip.end());
  // Parts of a face are added in the order of the strips.
  std::stable_sort(joined_.begin(), joined_.end(), [](const Part& a, const Part& b) { return a.face < b.face; });
  for (size_t first = 0; first < joined_.size();) {
    float pixels = 0;
    size_t last = first;
    for (; last < joined_.size() && joined_[last].face == joined_[first].face; ++last) pixels += joined_[last].pixels;
    for (; first < last; ++first) joined_[first].pixels = pixels;
  }
}

void FaceGatherer::Finish() {
  // Pieces that have no face in common.
  std::vector<std::span<const Part>> pieces;
  const auto cut = [&](const std::vector<Part>& parts) {
    for (size_t begin = 0; begin < parts.size();) {
      size_t end = std::min(parts.size(), begin + kPieceParts);
      while (end < parts.size() && parts[end].face == parts[end - 1].face) ++end;
      pieces.push_back(std::span(parts).subspan(begin, end - begin));
      begin = end;
    }
  };
  cut(joined_);
  for (const std::vector<Part>& of_strip : waiting_) cut(of_strip);
  ParallelForEach(pieces.size(), 1, [&](size_t i) {
    const std::span<const Part> piece = pieces[i];
    for (size_t k = 0; k < piece.size(); ++k) {
      if (k + kFar < piece.size()) PrefetchSums(piece[k + kFar].face);
      Add(piece[k].sums, piece[k].pixels, &(*sums_)[piece[k].face]);
    }
  });
}

}  // namespace tessera

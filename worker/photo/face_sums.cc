#include "worker/photo/face_sums.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>

#include "common/base/parallel.h"

namespace tessera {

using Eigen::Vector3d;

namespace {

void Add(const FaceSums& part, float pixels, FaceSums* total) {
  for (int c = 0; c < 3; ++c) {
    total->gradient[c] += part.gradient[c];
    total->curvature[c] += part.curvature[c];
  }
  total->pairs += part.pairs / pixels;
}

// Sums over consecutive pixels of a row.
struct RunSums {
  float g = 0, h = 0, gx = 0, hx = 0, pairs = 0;
};

// Writes the begins of the runs of equal values, and the end of the last. Returns the number of runs.
int FindRuns(const int32_t* values, int count, int32_t* starts) {
  int runs = 0;
  for (int i = 0; i < count; ++i) {
    starts[runs] = i;
    runs += i + 1 == count || values[i + 1] != values[i];
  }
  // Each entry holds the last pixel of its run up to here.
  for (int run = runs; run > 0; --run) starts[run] = starts[run - 1] + 1;
  starts[0] = 0;
  return runs;
}

// Where `b` is infinite, `a` must still be finite or infinite, not NaN: such products are not used.
void Multiply(const float* a, const float* b, int count, float* out) {
  for (int i = 0; i < count; ++i) out[i] = a[i] * b[i];
}

}  // namespace

void FaceGatherer::Begin(const TriangleMesh& mesh, const PosedCamera& camera, const FaceMap& map,
                         const std::vector<uint8_t>& own, int strips) {
  mesh_ = &mesh;
  camera_ = &camera;
  map_ = &map;
  own_ = &own;
  parts_.resize(strips);
  strips_of_face_.resize(mesh.faces.size(), 0);
}

FaceGatherer::Part FaceGatherer::ToCorners(const Moments& m) const {
  Part part;
  part.face = m.face;
  const auto [sum_g, sum_h, sum_gx, sum_hx, sum_gy, sum_hy, pairs, pixels] = m.sums;
  part.pixels = pixels;
  part.sums.pairs = pairs;
  if (sum_h == 0) return part;
  const Vector3d centre = camera_->Centre();
  const Vector3d a = mesh_->Corner(m.face, 0) - centre, b = mesh_->Corner(m.face, 1) - centre,
                 c = mesh_->Corner(m.face, 2) - centre;
  // z r = Σ φ_k V_k, so φ = z V⁻¹ r; the rows of V⁻¹ are cross products of the columns of V.
  const Vector3d rows[3] = {b.cross(c), c.cross(a), a.cross(b)};
  const double determinant = a.dot(rows[0]);
  if (determinant == 0) return part;
  const PinholeCamera& k = camera_->intrinsics;
  const double rx = (map_->x0 + m.x0 + 0.5 - k.cx) / k.fx, ry = (map_->y0 + m.y0 + 0.5 - k.cy) / k.fy;
  const double scale = 1 / determinant;
  const auto ray_sum = [&](double one, double x, double y) -> Vector3d {
    return camera_->rotation_cam_from_world.transpose() *
           Vector3d(scale * (rx * one + x / k.fx), scale * (ry * one + y / k.fy), scale * one);
  };
  const Vector3d g = ray_sum(sum_g, sum_gx, sum_gy), h = ray_sum(sum_h, sum_hx, sum_hy);
  for (int i = 0; i < 3; ++i) {
    part.sums.gradient[i] = static_cast<float>(rows[i].dot(g));
    part.sums.curvature[i] = static_cast<float>(rows[i].dot(h));
  }
  return part;
}

void FaceGatherer::AddStrip(int strip, const ReferenceStrip& planes, FaceSlots* slots_of_thread) {
  std::vector<uint64_t>& slots = slots_of_thread->slots;
  const uint64_t call = static_cast<uint64_t>(++slots_of_thread->call) << 32;
  if (slots.size() < mesh_->faces.size()) slots.resize(mesh_->faces.size(), 0);
  std::vector<Moments> found;
  found.reserve(parts_[strip].size() + 64);
  const int width = map_->width;
  // Per row: the begins of runs and the summands, computed first without branches.
  std::vector<int32_t> starts(width + 2);
  std::vector<float> gradient(width), curvature(width);
  for (int y = planes.row_begin; y < planes.row_end; ++y) {
    const int32_t* faces = map_->face.data() + static_cast<size_t>(y) * width;
    const float* count = planes.count.row(y);
    Multiply(planes.gradient.row(y), planes.depth.row(y), width, gradient.data());
    Multiply(planes.curvature.row(y), planes.depth.row(y), width, curvature.data());
    const int runs = FindRuns(faces, width, starts.data());
    for (int run = 0; run < runs; ++run) {
      const int begin = starts[run], end = starts[run + 1], face = faces[begin];
      if (face < 0 || (!own_->empty() && !(*own_)[face])) continue;
      uint64_t entry = slots[face];
      if ((entry ^ call) >> 32 != 0) {
        entry = slots[face] = call | found.size();
        found.push_back({face, begin, y, {}});
      }
      Moments& moments = found[entry & 0xffffffffu];
      RunSums sums;
      float dx = static_cast<float>(begin - moments.x0);
      for (int x = begin; x < end; ++x, dx += 1) {
        sums.g += gradient[x];
        sums.h += curvature[x];
        sums.gx += gradient[x] * dx;
        sums.hx += curvature[x] * dx;
        sums.pairs += count[x];
      }
      const float dy = static_cast<float>(y - moments.y0);
      const float parts[8] = {sums.g,      sums.h,      sums.gx,    sums.hx,
                              sums.g * dy, sums.h * dy, sums.pairs, static_cast<float>(end - begin)};
      for (int i = 0; i < 8; ++i) moments.sums[i] += parts[i];
    }
  }
  std::vector<Part>& parts = parts_[strip];
  parts.clear();
  for (const Moments& m : found) {
    parts.push_back(ToCorners(m));
    std::atomic_ref<uint8_t> strips(strips_of_face_[m.face]);
    uint8_t none = 0;
    if (!strips.compare_exchange_strong(none, 1, std::memory_order_relaxed)) strips.store(2, std::memory_order_relaxed);
  }
}

void FaceGatherer::Finish(std::vector<FaceSums>* sums) {
  // Faces in a single strip are added directly. Parts of faces in several strips are added in the order of the
  // strips.
  std::vector<std::vector<Part>> shared(parts_.size());
  ParallelForEach(parts_.size(), 1, [&](int64_t s) {
    for (const Part& part : parts_[s]) {
      if (strips_of_face_[part.face] > 1) {
        shared[s].push_back(part);
      } else {
        Add(part.sums, part.pixels, &(*sums)[part.face]);
        strips_of_face_[part.face] = 0;
      }
    }
  });
  std::vector<Part> rest;
  for (const std::vector<Part>& of_strip : shared) rest.insert(rest.end(), of_strip.begin(), of_strip.end());
  std::stable_sort(rest.begin(), rest.end(), [](const Part& a, const Part& b) { return a.face < b.face; });
  for (size_t first = 0; first < rest.size();) {
    const int32_t face = rest[first].face;
    float pixels = 0;
    size_t last = first;
    for (; last < rest.size() && rest[last].face == face; ++last) pixels += rest[last].pixels;
    for (; first < last; ++first) Add(rest[first].sums, pixels, &(*sums)[face]);
    strips_of_face_[face] = 0;
  }
}

}  // namespace tessera

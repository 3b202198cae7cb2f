#include "worker/refine/face_sums.h"

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

}  // namespace

void FaceGatherer::Begin(const TriangleMesh& mesh, const PosedCamera& camera, const FaceMap& map, int strips) {
  mesh_ = &mesh;
  camera_ = &camera;
  map_ = &map;
  parts_.resize(strips);
  strips_of_face_.resize(mesh.faces.size(), 0);
}

FaceGatherer::Part FaceGatherer::ToCorners(const Moments& m) const {
  Part part;
  part.face = m.face;
  part.pixels = m.pixels;
  part.sums.pairs = m.pairs;
  if (m.h == 0) return part;
  const Vector3d centre = camera_->Centre();
  const Vector3d a = mesh_->Corner(m.face, 0) - centre, b = mesh_->Corner(m.face, 1) - centre,
                 c = mesh_->Corner(m.face, 2) - centre;
  // z r = Σ φ_k V_k, so φ = z V⁻¹ r, and the rows of V⁻¹ are cross products of its columns.
  const Vector3d rows[3] = {b.cross(c), c.cross(a), a.cross(b)};
  const double determinant = a.dot(rows[0]);
  if (determinant == 0) return part;
  const PinholeCamera& k = camera_->intrinsics;
  const double rx = (m.x0 + 0.5 - k.cx) / k.fx, ry = (m.y0 + 0.5 - k.cy) / k.fy, scale = 1 / determinant;
  const auto ray_sum = [&](double one, double x, double y) -> Vector3d {
    return camera_->rotation_cam_from_world.transpose() *
           Vector3d(scale * (rx * one + x / k.fx), scale * (ry * one + y / k.fy), scale * one);
  };
  const Vector3d g = ray_sum(m.g, m.gx, m.gy), h = ray_sum(m.h, m.hx, m.hy);
  for (int i = 0; i < 3; ++i) {
    part.sums.gradient[i] = static_cast<float>(rows[i].dot(g));
    part.sums.curvature[i] = static_cast<float>(rows[i].dot(h));
  }
  return part;
}

void FaceGatherer::AddStrip(int strip, const ReferenceStrip& planes, FaceSlots* slots_of_thread) {
  // Where a face's entry of `found` is. Never cleared: an entry counts only if `found` agrees.
  std::vector<uint32_t>& slots = slots_of_thread->slots;
  if (slots.size() < mesh_->faces.size()) slots.resize(mesh_->faces.size(), 0);
  std::vector<Moments> found;
  for (int y = planes.row_begin; y < planes.row_end; ++y) {
    const int32_t* faces = map_->face.data() + static_cast<size_t>(y) * map_->width;
    const float* gradient = planes.gradient.row(y);
    const float* curvature = planes.curvature.row(y);
    const float* count = planes.count.row(y);
    const float* depth = planes.depth.row(y);
    for (int x = 0; x < map_->width;) {
      const int32_t face = faces[x];
      if (face < 0) {
        ++x;
        continue;
      }
      const int begin = x;
      float g = 0, gx = 0, h = 0, hx = 0, pairs = 0;
      for (; x < map_->width && faces[x] == face; ++x) {
        const float dx = static_cast<float>(x - begin), gz = gradient[x] * depth[x], hz = curvature[x] * depth[x];
        g += gz;
        gx += gz * dx;
        h += hz;
        hx += hz * dx;
        pairs += count[x];
      }
      uint32_t slot = slots[face];
      if (slot >= found.size() || found[slot].face != face) {
        slot = slots[face] = static_cast<uint32_t>(found.size());
        found.emplace_back();
        found.back().face = face;
        found.back().x0 = begin;
        found.back().y0 = y;
      }
      Moments& m = found[slot];
      const float dx = static_cast<float>(begin - m.x0), dy = static_cast<float>(y - m.y0);
      m.g += g;
      m.gx += gx + dx * g;
      m.gy += dy * g;
      m.h += h;
      m.hx += hx + dx * h;
      m.hy += dy * h;
      m.pairs += pairs;
      m.pixels += static_cast<float>(x - begin);
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
  // A face that one strip alone has is added at once; of the others the strips' parts are added in their order.
  std::vector<std::vector<Part>> shared(parts_.size());
  ParallelFor(static_cast<int64_t>(parts_.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t s = begin; s < end; ++s) {
      for (const Part& part : parts_[s]) {
        if (strips_of_face_[part.face] > 1) {
          shared[s].push_back(part);
        } else {
          Add(part.sums, part.pixels, &(*sums)[part.face]);
          strips_of_face_[part.face] = 0;
        }
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

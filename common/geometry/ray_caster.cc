#include "common/geometry/ray_caster.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <new>

namespace tessera {
namespace {

// Limits the instruction set, so that hits on edges are equal on all machines.
constexpr char kDeviceConfig[] = "max_isa=avx2";

struct DeviceRelease {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
using DevicePtr = std::unique_ptr<RTCDeviceTy, DeviceRelease>;
using ScenePtr = std::unique_ptr<RTCSceneTy, SceneRelease>;

// A ray clipped to the mesh's bounding box: the interval [begin_m, end_m] along a unit direction, in double precision.
struct ClippedRay {
  Eigen::Vector3d start;  // relative to the centre, at begin_m
  Eigen::Vector3d unit;
  double begin_m = 0;
  double end_m = 0;
};

}  // namespace

struct RayCaster::Impl {
  DevicePtr device;
  ScenePtr scene;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::AlignedBox3d box;  // relative to the centre, padded
  // Owned by Embree; valid as long as the scene.
  const float* vertices = nullptr;
  const uint32_t* faces = nullptr;

  Eigen::Vector3d Vertex(uint32_t index) const {
    const float* p = vertices + 3 * size_t{index};
    return {p[0], p[1], p[2]};
  }

  // False if the ray misses the box within [near_m, far_m] or is not finite.
  bool Clip(const Eigen::Vector3d& origin, const Eigen::Vector3d& unit, double near_m, double far_m,
            ClippedRay& out) const {
    const Eigen::Vector3d local = origin - centre;
    for (int axis = 0; axis < 3; ++axis) {
      const double low = box.min()[axis] - local[axis];
      const double high = box.max()[axis] - local[axis];
      if (unit[axis] == 0) {
        if (low > 0 || high < 0) return false;
        continue;
      }
      const double a = low / unit[axis];
      const double b = high / unit[axis];
      near_m = std::max(near_m, std::min(a, b));
      far_m = std::min(far_m, std::max(a, b));
    }
    if (!(near_m < far_m) || !local.allFinite()) return false;
    out.start = local + near_m * unit;
    out.unit = unit;
    out.begin_m = near_m;
    out.end_m = far_m;
    return true;
  }

  static RTCRay ToEmbree(const ClippedRay& ray) {
    RTCRay out{};
    out.org_x = static_cast<float>(ray.start.x());
    out.org_y = static_cast<float>(ray.start.y());
    out.org_z = static_cast<float>(ray.start.z());
    out.dir_x = static_cast<float>(ray.unit.x());
    out.dir_y = static_cast<float>(ray.unit.y());
    out.dir_z = static_cast<float>(ray.unit.z());
    out.tnear = 0;
    out.tfar = static_cast<float>(ray.end_m - ray.begin_m);
    out.mask = ~0u;
    return out;
  }
};

RayCaster::RayCaster(const MeshSpans& mesh, RayTree tree) : impl_(std::make_unique<Impl>()) {
  if (mesh.faces.empty() || mesh.vertices.empty()) return;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& vertex : mesh.vertices) box.extend(vertex);
  impl_->centre = box.center();
  const double pad = 1e-6 * box.diagonal().norm() + std::numeric_limits<float>::min();
  impl_->box = Eigen::AlignedBox3d(box.min() - impl_->centre - Eigen::Vector3d::Constant(pad),
                                   box.max() - impl_->centre + Eigen::Vector3d::Constant(pad));

  impl_->device.reset(rtcNewDevice(kDeviceConfig));
  if (!impl_->device) throw std::bad_alloc();
  RTCDevice device = impl_->device.get();
  impl_->scene.reset(rtcNewScene(device));
  rtcSetSceneFlags(impl_->scene.get(), RTC_SCENE_FLAG_ROBUST);
  const RTCBuildQuality quality = tree == RayTree::kQuick ? RTC_BUILD_QUALITY_LOW : RTC_BUILD_QUALITY_MEDIUM;
  rtcSetSceneBuildQuality(impl_->scene.get(), quality);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetGeometryBuildQuality(geometry, quality);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                               3 * sizeof(float), mesh.vertices.size()));
  auto* faces = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                               sizeof(Triangle), mesh.faces.size()));
  if (vertices == nullptr || faces == nullptr) {
    rtcReleaseGeometry(geometry);
    throw std::bad_alloc();
  }
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3d local = mesh.vertices[v] - impl_->centre;
    for (int axis = 0; axis < 3; ++axis) vertices[3 * v + axis] = static_cast<float>(local[axis]);
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) std::copy(mesh.faces[f].begin(), mesh.faces[f].end(), faces + 3 * f);
  impl_->vertices = vertices;
  impl_->faces = faces;
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(impl_->scene.get(), geometry);
  rtcReleaseGeometry(geometry);
  // Build the tree on one thread. Else the order of faces in it would depend on the number of threads, and so would the
  // face that a ray through a common edge hits.
  tbb::task_arena(1).execute([this] { rtcCommitScene(impl_->scene.get()); });
  if (rtcGetDeviceError(device) != RTC_ERROR_NONE) throw std::bad_alloc();
}

RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

RayHit RayCaster::Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double near, double far) const {
  RayHit hit;
  const double length = direction.norm();
  ClippedRay ray;
  if (!impl_->scene || !(length > 0) || !std::isfinite(length)) return hit;
  if (!impl_->Clip(origin, direction / length, near * length, far * length, ray)) return hit;

  RTCRayHit query{};
  query.ray = Impl::ToEmbree(ray);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(impl_->scene.get(), &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;

  hit.face = query.hit.primID;
  double along_m = query.ray.tfar;
  hit.u = query.hit.u;
  hit.v = query.hit.v;
  // Embree computes in float, so compute the intersection with the face's plane again in double.
  const uint32_t* face = impl_->faces + 3 * static_cast<size_t>(hit.face);
  const Eigen::Vector3d a = impl_->Vertex(face[0]);
  const Eigen::Vector3d ab = impl_->Vertex(face[1]) - a;
  const Eigen::Vector3d ac = impl_->Vertex(face[2]) - a;
  const Eigen::Vector3d normal = ab.cross(ac);
  const double slope = normal.dot(ray.unit);
  if (std::abs(slope) > 1e-6 * normal.norm()) {
    const Eigen::Vector3d to_a = a - ray.start;
    const Eigen::Vector3d q = ray.unit.cross(to_a);
    along_m = normal.dot(to_a) / slope;
    hit.u = std::clamp(-ac.dot(q) / slope, 0.0, 1.0);
    hit.v = std::clamp(ab.dot(q) / slope, 0.0, 1.0 - hit.u);
  }
  hit.distance = (ray.begin_m + along_m) / length;
  return hit;
}

bool RayCaster::Occluded(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double margin_m) const {
  const Eigen::Vector3d segment = to - from;
  const double length = segment.norm();
  ClippedRay ray;
  if (!impl_->scene || !(length > 0) || !std::isfinite(length)) return false;
  if (!impl_->Clip(from, segment / length, margin_m, length - margin_m, ray)) return false;
  RTCRay query = Impl::ToEmbree(ray);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(impl_->scene.get(), &context, &query);
  return query.tfar < 0;
}

}  // namespace tessera

#include "common/geometry/ray_caster.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {
namespace {

// Limits the instruction set, so that hits on edges are equal on all machines.
constexpr char kDeviceConfig[] = "max_isa=avx2";

constexpr size_t kQuickScenes = 16;  // each built on one thread; a ray is tested against all
constexpr int64_t kCopyGrain = 1 << 14;

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
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::AlignedBox3d box;  // relative to the centre, padded
  // Read by Embree: valid as long as the scenes.
  std::vector<float> vertices;
  std::vector<Triangle> faces;
  std::vector<ScenePtr> scenes;  // each of faces_of_scene consecutive faces, the last of the rest
  size_t faces_of_scene = 0;

  Eigen::Vector3d Vertex(uint32_t index) const {
    const float* p = &vertices[3 * size_t{index}];
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

  // Returns Embree's error on this thread.
  RTCError MakeScene(size_t index, RayTree tree) {
    RTCScene scene = rtcNewScene(device.get());
    scenes[index].reset(scene);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    const RTCBuildQuality quality = tree == RayTree::kQuick ? RTC_BUILD_QUALITY_LOW : RTC_BUILD_QUALITY_MEDIUM;
    rtcSetSceneBuildQuality(scene, quality);
    RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryBuildQuality(geometry, quality);
    const size_t first = index * faces_of_scene;
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, vertices.data(), 0,
                               3 * sizeof(float), vertices.size() / 3);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, &faces[first], 0, sizeof(Triangle),
                               std::min(faces_of_scene, faces.size() - first));
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    // Build the tree on one thread. Else the order of faces in it would depend on the number of threads, and so would
    // the face that a ray through a common edge hits.
    tbb::task_arena(1).execute([&] { rtcCommitScene(scene); });
    return rtcGetDeviceError(device.get());
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
  // Embree reads 16 bytes at the last vertex.
  impl_->vertices.resize(3 * mesh.vertices.size() + 1);
  ParallelForEach(mesh.vertices.size(), kCopyGrain, [&](size_t v) {
    const Eigen::Vector3d local = mesh.vertices[v] - impl_->centre;
    for (int axis = 0; axis < 3; ++axis) impl_->vertices[3 * v + axis] = static_cast<float>(local[axis]);
  });
  impl_->faces.assign(mesh.faces.begin(), mesh.faces.end());
  const size_t count = tree == RayTree::kQuick ? kQuickScenes : 1;
  impl_->faces_of_scene = (mesh.faces.size() + count - 1) / count;
  impl_->scenes.resize((mesh.faces.size() + impl_->faces_of_scene - 1) / impl_->faces_of_scene);
  std::vector<RTCError> errors(impl_->scenes.size());
  ParallelForEach(errors.size(), 1, [&](size_t i) { errors[i] = impl_->MakeScene(i, tree); });
  for (const RTCError error : errors) {
    if (error != RTC_ERROR_NONE) throw std::bad_alloc();
  }
}

RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

RayHit RayCaster::Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double near, double far) const {
  RayHit hit;
  const double length = direction.norm();
  ClippedRay ray;
  if (impl_->scenes.empty() || !(length > 0) || !std::isfinite(length)) return hit;
  if (!impl_->Clip(origin, direction / length, near * length, far * length, ray)) return hit;

  RTCRayHit query{};
  query.ray = Impl::ToEmbree(ray);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  for (size_t i = 0; i < impl_->scenes.size(); ++i) {
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(impl_->scenes[i].get(), &context, &query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
    hit.face = static_cast<int64_t>(i * impl_->faces_of_scene + query.hit.primID);
  }
  if (!hit.hit()) return hit;

  double along_m = query.ray.tfar;
  hit.u = query.hit.u;
  hit.v = query.hit.v;
  // Embree computes in float, so compute the intersection with the face's plane again in double.
  const Triangle& face = impl_->faces[static_cast<size_t>(hit.face)];
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
  if (impl_->scenes.empty() || !(length > 0) || !std::isfinite(length)) return false;
  if (!impl_->Clip(from, segment / length, margin_m, length - margin_m, ray)) return false;
  RTCRay query = Impl::ToEmbree(ray);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  return std::any_of(impl_->scenes.begin(), impl_->scenes.end(), [&](const ScenePtr& scene) {
    rtcOccluded1(scene.get(), &context, &query);
    return query.tfar < 0;
  });
}

}  // namespace tessera

#include "common/geometry/nearest_surface.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace tessera {

Eigen::Vector3d NearestPointOfTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                       const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const double scale = 1 / (va + vb + vc);
  return a + vb * scale * ab + vc * scale * ac;
}

struct NearestSurface::Impl {
  const TriangleMesh* mesh = nullptr;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double extent_m = 0;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
};

namespace {

struct Search {
  const TriangleMesh* mesh;
  Eigen::Vector3d query;
  double slack_m;  // upper bound of the float rounding in the tree
  double best_squared = std::numeric_limits<double>::infinity();
  int64_t face = -1;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
};

bool Visit(RTCPointQueryFunctionArguments* args) {
  Search& search = *static_cast<Search*>(args->userPtr);
  const int64_t face = args->primID;
  const Eigen::Vector3d point = NearestPointOfTriangle(search.query, search.mesh->Corner(face, 0),
                                                       search.mesh->Corner(face, 1), search.mesh->Corner(face, 2));
  const double squared = (point - search.query).squaredNorm();
  if (squared > search.best_squared || (squared == search.best_squared && face > search.face)) return false;
  search.best_squared = squared;
  search.face = face;
  search.point = point;
  args->query->radius = static_cast<float>(std::sqrt(squared) * (1 + 1e-6) + search.slack_m);
  return true;
}

}  // namespace

NearestSurface::NearestSurface(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>()) {
  impl_->mesh = &mesh;
  if (mesh.faces.empty()) return;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& v : mesh.vertices) box.extend(v);
  impl_->centre = box.center();
  impl_->extent_m = 0.5 * box.sizes().maxCoeff();
  impl_->device = rtcNewDevice(nullptr);
  impl_->scene = rtcNewScene(impl_->device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  float* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                3 * sizeof(float), mesh.vertices.size()));
  for (const Eigen::Vector3d& v : mesh.vertices) {
    for (int k = 0; k < 3; ++k) *vertices++ = static_cast<float>(v[k] - impl_->centre[k]);
  }
  uint32_t* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), mesh.faces.size()));
  for (const Triangle& face : mesh.faces) indices = std::copy(face.begin(), face.end(), indices);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(impl_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(impl_->scene);
}

NearestSurface::~NearestSurface() = default;
NearestSurface::NearestSurface(NearestSurface&&) noexcept = default;
NearestSurface& NearestSurface::operator=(NearestSurface&&) noexcept = default;

NearestPoint NearestSurface::Find(const Eigen::Vector3d& p) const {
  if (!impl_->scene) return {};
  const Eigen::Vector3d centred = p - impl_->centre;
  Search search{impl_->mesh, p,
                8 * std::numeric_limits<float>::epsilon() * (impl_->extent_m + centred.cwiseAbs().maxCoeff())};
  RTCPointQuery query{};
  query.x = static_cast<float>(centred.x());
  query.y = static_cast<float>(centred.y());
  query.z = static_cast<float>(centred.z());
  query.radius = std::numeric_limits<float>::infinity();
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(impl_->scene, &query, &context, Visit, &search);
  return {search.face, search.point, std::sqrt(search.best_squared)};
}

}  // namespace tessera

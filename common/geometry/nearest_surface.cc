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

  // Upper bound of the float rounding in the tree near `p`.
  double SlackAt(const Eigen::Vector3d& p) const {
    return 8 * std::numeric_limits<float>::epsilon() * (extent_m + (p - centre).cwiseAbs().maxCoeff());
  }

  void Query(const Eigen::Vector3d& p, float radius, RTCPointQueryFunction visit, void* user) const {
    const Eigen::Vector3d centred = p - centre;
    RTCPointQuery query{};
    query.x = static_cast<float>(centred.x());
    query.y = static_cast<float>(centred.y());
    query.z = static_cast<float>(centred.z());
    query.radius = radius;
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(scene, &query, &context, visit, user);
  }

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

struct Proximity {
  const TriangleMesh* mesh;
  Eigen::Vector3d query;
  double squared;
  bool found = false;
};

bool VisitUntilNear(RTCPointQueryFunctionArguments* args) {
  Proximity& proximity = *static_cast<Proximity*>(args->userPtr);
  const TriangleMesh& mesh = *proximity.mesh;
  const Eigen::Vector3d point = NearestPointOfTriangle(proximity.query, mesh.Corner(args->primID, 0),
                                                       mesh.Corner(args->primID, 1), mesh.Corner(args->primID, 2));
  if (proximity.found || (point - proximity.query).squaredNorm() > proximity.squared) return false;
  proximity.found = true;
  args->query->radius = 0;  // ends the query
  return true;
}

}  // namespace

NearestSurface::NearestSurface(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>()) {
  impl_->mesh = &mesh;
  if (mesh.faces.empty()) return;
  Eigen::Vector3d low = mesh.vertices.front(), high = low;
  for (const Eigen::Vector3d& v : mesh.vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
  impl_->centre = 0.5 * (low + high);
  impl_->extent_m = 0.5 * (high - low).maxCoeff();
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
  Search search{impl_->mesh, p, impl_->SlackAt(p)};
  impl_->Query(p, std::numeric_limits<float>::infinity(), Visit, &search);
  return {search.face, search.point, std::sqrt(search.best_squared)};
}

bool NearestSurface::IsWithin(const Eigen::Vector3d& p, double distance_m) const {
  if (!impl_->scene) return false;
  Proximity proximity{impl_->mesh, p, distance_m * distance_m};
  const double radius_m = distance_m * (1 + 1e-6) + impl_->SlackAt(p);
  impl_->Query(p, static_cast<float>(radius_m), VisitUntilNear, &proximity);
  return proximity.found;
}

}  // namespace tessera

#include "worker/tile/tile_fit.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <utility>

#include "common/base/parallel.h"
#include "common/check/patch_match.h"
#include "common/geometry/ray_caster.h"
#include "worker/photo/texels.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

constexpr size_t kFitPoints = 3000, kFitPairs = 48, kFitPatches = 60;  // of a tile; of a pair
constexpr int64_t kFitPixels = 12'000'000;                             // larger crops are compared on a coarser level
constexpr int64_t kRowGrain = 64;
constexpr size_t kFacesPerRay = 3;                                     // more are worth a quick tree
constexpr double kFitAngle_cos = 0.2;                                  // between normal and ray: 78 degrees
constexpr double kLeastWorseShare = 0.01;                              // of the patches
constexpr double kChangedZncc = 0.05;                                  // smaller changes are noise

// A point of a face of the package.
struct FacePoint {
  uint32_t face = 0;
  Vector3d weights;  // of its corners
};

template <class T>
std::vector<T> EvenlyPicked(const std::vector<T>& items, size_t count) {
  if (items.size() <= count) return items;
  std::vector<T> picked;
  for (size_t i = 0; i < count; ++i) picked.push_back(items[i * items.size() / count]);
  return picked;
}

// Points spread evenly over the area of the core.
std::vector<FacePoint> CorePoints(const TileWorkspace& work) {
  const TriangleMesh& mesh = work.package().mesh;
  double area = 0;
  for (const uint32_t f : work.core_faces()) area += FaceArea(mesh, f);
  const double spacing = area / kFitPoints;
  std::vector<FacePoint> points;
  if (!(spacing > 0) || !std::isfinite(spacing)) return points;
  double next = spacing / 2, passed = 0;
  for (const uint32_t f : work.core_faces()) {
    passed += FaceArea(mesh, f);
    for (; next < passed; next += spacing) {
      const uint32_t random = static_cast<uint32_t>(points.size()) * 2654435761u;
      double u = (random >> 16) / 65536.0, v = (random & 0xffff) / 65536.0;
      if (u + v > 1) u = 1 - u, v = 1 - v;
      points.push_back({f, {1 - u - v, u, v}});
    }
  }
  return points;
}

SurfacePoint PointOn(const std::vector<Triangle>& faces, const std::vector<Vector3d>& positions,
                     const FacePoint& point) {
  const Triangle& face = faces[point.face];
  const Vector3d &a = positions[face[0]], &b = positions[face[1]], &c = positions[face[2]];
  return {point.weights[0] * a + point.weights[1] * b + point.weights[2] * c, (b - a).cross(c - a).normalized()};
}

// The surface at one time.
class CoreSurface {
 public:
  CoreSurface(const std::vector<Triangle>& faces, const std::vector<Vector3d>& positions, RayTree tree)
      : faces_(faces), positions_(positions), caster_(MeshSpans(positions, faces), tree) {}

  SurfacePoint At(const FacePoint& point) const { return PointOn(faces_, positions_, point); }
  bool Sees(const PosedCamera& camera, const SurfacePoint& point) const {
    const Vector3d centre = camera.Centre(), ray = point.position - centre;
    return camera.InImage(camera.Project(point.position)) && point.normal.dot(ray) < -kFitAngle_cos * ray.norm() &&
           !caster_.Occluded(centre, point.position, 1e-3 * ray.norm());
  }

 private:
  const std::vector<Triangle>& faces_;
  const std::vector<Vector3d>& positions_;
  const RayCaster caster_;
};

struct CorePair {
  ViewPair views;
  std::vector<uint32_t> points;
};

// Removes from each pair the points that its views do not both see.
void KeepSeen(const CoreSurface& surface, const std::vector<FacePoint>& points, const TileImages& images,
              std::vector<CorePair>* pairs) {
  ParallelForEach(pairs->size(), 1, [&](size_t i) {
    CorePair& pair = (*pairs)[i];
    std::erase_if(pair.points, [&](uint32_t p) {
      const SurfacePoint at = surface.At(points[p]);
      return !surface.Sees(images.views[pair.views.reference].camera, at) ||
             !surface.Sees(images.views[pair.views.other].camera, at);
    });
  });
}

// The window of a view as the comparison of patches reads it.
struct CropImage {
  FloatImage luminance;
  PatchView view;
};

StatusOr<std::unique_ptr<CropImage>> LoadCrop(const RefineView& view) {
  int level = 0;
  TexelShape shape;
  shape.rect = view.pixels->rect();
  while (static_cast<int64_t>(shape.pixels()) > kFitPixels && level + 1 < kTexelLevels) {
    shape = shape.Half();
    ++level;
  }
  TESSERA_ASSIGN_OR_RETURN(const StoredTexels stored, view.pixels->Level(level));
  const PixelRect &part = shape.rect, &all = stored.rect;
  auto crop = std::make_unique<CropImage>();
  crop->luminance = FloatImage(part.width(), part.height());
  ParallelForEach(part.height(), kRowGrain, [&](int64_t row) {
    const size_t from = static_cast<size_t>(part.y0 - all.y0 + row) * all.width() + (part.x0 - all.x0);
    float* const to = &crop->luminance.data[static_cast<size_t>(row) * part.width()];
    for (int x = 0; x < part.width(); ++x) {
      const uint16_t code = stored.luminance[from + x];
      to[x] = code == 0 ? std::nanf("") : static_cast<float>(code - 1) / Texels::kLuminanceSteps;
    }
  });
  if (stored.release) stored.release();
  crop->view = {&crop->luminance, PyramidCamera(view.camera, level)};
  PinholeCamera& intrinsics = crop->view.camera.intrinsics;
  intrinsics.cx -= part.x0, intrinsics.cy -= part.y0;
  intrinsics.width = part.width(), intrinsics.height = part.height();
  return crop;
}

json ToJsonArray(const FitChange& c) { return {c.patches, c.start, c.result, c.lost, c.gained}; }
FitChange FromJsonArray(const json& j) { return {j.at(0), j.at(1), j.at(2), j.at(3), j.at(4)}; }

}  // namespace

void FitChange::Add(const FitChange& other) {
  patches += other.patches;
  start += other.start;
  result += other.result;
  lost += other.lost;
  gained += other.gained;
}

bool FitChange::IsWorse() const {
  const auto difference = static_cast<double>(lost - gained);
  return difference > 4 * std::sqrt(static_cast<double>(lost + gained)) &&
         difference > kLeastWorseShare * static_cast<double>(patches);
}

StatusOr<TileFit> CompareFit(const TileWorkspace& work, const TileImages& images,
                             const std::vector<Vector3d>& positions, const TaskControl& control) {
  const TilePackage& package = work.package();
  const std::vector<FacePoint> points = CorePoints(work);
  std::vector<CorePair> pairs;
  size_t rays = 0;
  for (const ViewPair& views : EvenlyPicked(images.pairs, kFitPairs)) {
    CorePair& pair = pairs.emplace_back();
    pair.views = views;
    for (uint32_t i = 0; i < points.size(); ++i) {
      const std::vector<uint8_t>& selected = images.groups.selected[images.groups.group_of_face[points[i].face]];
      if (selected[views.reference] && selected[views.other]) pair.points.push_back(i);
    }
    rays += 2 * pair.points.size();
  }
  {
    // Each surface's ray tree is built on one thread, so that hits do not depend on the threads: both at once.
    const RayTree tree = package.mesh.faces.size() > kFacesPerRay * rays ? RayTree::kQuick : RayTree::kThorough;
    std::array<std::unique_ptr<CoreSurface>, 2> surfaces;
    ParallelForEach(surfaces.size(), 1, [&](size_t i) {
      surfaces[i] = std::make_unique<CoreSurface>(package.mesh.faces, i == 0 ? package.mesh.vertices : positions, tree);
    });
    for (const auto& surface : surfaces) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      KeepSeen(*surface, points, images, &pairs);
    }
  }

  struct Compared {
    int32_t views[2] = {0, 0};
    Vector3d position;
    PatchCorrelation start;
    float result = 0;
  };
  std::vector<Compared> compared;
  std::vector<float> at_random;
  std::map<int, std::unique_ptr<CropImage>> crops;
  for (size_t p = 0; p < pairs.size(); ++p) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(p) / static_cast<double>(pairs.size()), "comparing the fit of images");
    const ViewPair& views = pairs[p].views;
    const std::vector<uint32_t> chosen = EvenlyPicked(pairs[p].points, kFitPatches);
    if (chosen.empty()) continue;
    std::erase_if(crops, [&](const auto& crop) { return crop.first != views.reference && crop.first != views.other; });
    std::vector<int> missing;
    for (const int view : {views.reference, views.other}) {
      if (!crops.contains(view)) missing.push_back(view);
    }
    std::vector<StatusOr<std::unique_ptr<CropImage>>> loaded(missing.size());
    ParallelForEach(missing.size(), 1, [&](size_t i) { loaded[i] = LoadCrop(images.views[missing[i]]); });
    for (size_t i = 0; i < missing.size(); ++i) {
      TESSERA_ASSIGN_OR_RETURN(crops[missing[i]], std::move(loaded[i]));
    }
    const PatchView &reference = crops.at(views.reference)->view, &other = crops.at(views.other)->view;
    std::vector<std::optional<Compared>> of_pair(chosen.size());
    ParallelForEach(chosen.size(), 1, [&](size_t i) {
      const FacePoint& point = points[chosen[i]];
      const SurfacePoint before = PointOn(package.mesh.faces, package.mesh.vertices, point);
      const SurfacePoint after = PointOn(package.mesh.faces, positions, point);
      std::optional<PatchCorrelation> at_start = CorrelateAtRandom(reference, other, before, chosen[i]);
      const float in_result = CorrelatePatch(reference, other, after);
      if (!at_start || std::isnan(in_result)) return;
      of_pair[i] = {{images.views[views.reference].id, images.views[views.other].id},
                    before.position,
                    *std::move(at_start),
                    in_result};
    });
    for (std::optional<Compared>& found : of_pair) {
      if (!found) continue;
      at_random.insert(at_random.end(), found->start.at_random.begin(), found->start.at_random.end());
      compared.push_back(*std::move(found));
    }
  }
  TileFit fit;
  if (compared.empty() || at_random.empty()) return fit;
  const auto chance = at_random.begin() + static_cast<ptrdiff_t>(at_random.size() * 95 / 100);
  std::nth_element(at_random.begin(), chance, at_random.end());
  for (const Compared& patch : compared) {
    const bool start = patch.start.correlation > *chance, end = patch.result > *chance;
    const double rise = patch.result - patch.start.correlation;
    const FitChange change = {1, start, end, rise<-kChangedZncc, rise> kChangedZncc};
    fit.all.Add(change);
    for (const int32_t view : patch.views) fit.views[view].Add(change);
    fit.centre_m += patch.position;
  }
  fit.centre_m /= static_cast<double>(compared.size());
  return fit;
}

std::string ToJson(const TileFit& fit) {
  json views = json::object();
  for (const auto& [view, change] : fit.views) views[std::to_string(view)] = ToJsonArray(change);
  return json{{"all", ToJsonArray(fit.all)},
              {"views", views},
              {"centre_m", {fit.centre_m.x(), fit.centre_m.y(), fit.centre_m.z()}}}
      .dump();
}

TileFit ParseTileFit(const std::string& text) {
  TileFit fit;
  try {
    const json j = json::parse(text);
    fit.all = FromJsonArray(j.at("all"));
    for (const auto& [view, change] : j.at("views").items()) fit.views[std::stoi(view)] = FromJsonArray(change);
    for (int k = 0; k < 3; ++k) fit.centre_m[k] = j.at("centre_m").at(k);
  } catch (const std::exception&) {
    return {};
  }
  return fit;
}

}  // namespace tessera

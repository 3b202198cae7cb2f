#include "worker/changes/change_report.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/imaging/image_io.h"
#include "common/render/annotation.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kDegrees = 180 / 3.141592653589793;

// Rounds to the value that the text with `digits` decimals has.
double Decimals(double value, int digits) { return std::stod(absl::StrFormat("%.*f", digits, value)); }

std::array<uint8_t, 3> KindColor(ChangeKind kind) {
  switch (kind) {
    case ChangeKind::kBuilt:
      return {213, 50, 44};
    case ChangeKind::kDemolished:
      return {38, 96, 196};
    case ChangeKind::kGrown:
      return {46, 160, 67};
    case ChangeKind::kFelled:
      return {230, 140, 20};
    case ChangeKind::kLabel:
      return {160, 70, 190};
  }
  return {};
}

Eigen::Vector3d LocalPoint(const ChangeReport& report, double x_m, double y_m, double height_m) {
  const GroundPlane& ground = report.ground;
  return ground.axis_x * x_m + ground.axis_y * y_m + ground.axis_x.cross(ground.axis_y) * height_m;
}

// Longitude and latitude in degrees; nullopt if the scene is not georeferenced.
std::optional<Eigen::Vector2d> LonLat(const ChangeReport& report, const Eigen::Vector3d& p_local) {
  const StatusOr<Eigen::Vector3d> place = report.scene.frame.GeodeticFromLocal(p_local);
  if (!place.ok()) return {};
  return Eigen::Vector2d(place->y(), place->x()) * kDegrees;
}

bool IsGeographic(const ChangeReport& report) { return report.scene.frame.crs().kind != Crs::Kind::kLocal; }

Json LabelName(const ChangeReport& report, uint8_t label) {
  if (label >= report.scene.classes.size()) return nullptr;
  return report.scene.classes[label].name;
}

Json Followed(const ChangeArea& area) { return area.followed ? Json(*area.followed) : Json(nullptr); }

Json SceneRing(const ChangeReport& report, const Ring& ring, double height_m) {
  Json points = Json::array();
  for (const Eigen::Vector2d& p : ring) {
    const Eigen::Vector3d q = report.scene.frame.SceneFromLocal(LocalPoint(report, p.x(), p.y(), height_m));
    points.push_back({Decimals(q.x(), 3), Decimals(q.y(), 3)});
  }
  return points;
}

Json SharesJson(const EpochDisagreement::Shares& shares) {
  return {{"heights", Decimals(shares.heights, 4)}, {"labels", Decimals(shares.labels, 4)}};
}

// Two opposite corners.
Json SceneBox(const ChangeReport& report, const ChangeArea& area) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector2d& p : area.outline.outer) {
    for (const double height_m : {area.low_m, area.high_m}) {
      box.extend(report.scene.frame.SceneFromLocal(LocalPoint(report, p.x(), p.y(), height_m)));
    }
  }
  Json corners = Json::array();
  for (const Eigen::Vector3d& q : {box.min(), box.max()}) {
    corners.push_back({Decimals(q.x(), 3), Decimals(q.y(), 3), Decimals(q.z(), 3)});
  }
  return corners;
}

// Closed: RFC 7946 repeats the first corner.
Json GeoRing(const ChangeReport& report, const Ring& ring, double height_m) {
  Json points = Json::array();
  if (!IsGeographic(report)) {
    points = SceneRing(report, ring, height_m);
  } else {
    for (const Eigen::Vector2d& p : ring) {
      const std::optional<Eigen::Vector2d> q = LonLat(report, LocalPoint(report, p.x(), p.y(), height_m));
      if (q) points.push_back({Decimals(q->x(), 8), Decimals(q->y(), 8)});
    }
  }
  if (!points.empty()) points.push_back(Json(points.front()));
  return points;
}

// Shaded relief of the old surface, lit from the upper left: 60 to 235.
uint8_t Relief(const SurfaceRaster& surface, int x, int y) {
  const auto height = [&](int i, int j) {
    i = std::clamp(i, 0, surface.width() - 1);
    j = std::clamp(j, 0, surface.height() - 1);
    return surface.height_m[static_cast<size_t>(j) * surface.width() + i];
  };
  const double dx = (height(x + 1, y) - height(x - 1, y)) / (2 * surface.cell_m);
  const double dy = (height(x, y + 1) - height(x, y - 1)) / (2 * surface.cell_m);
  if (std::isnan(dx) || std::isnan(dy)) return 200;
  const Eigen::Vector3d normal = Eigen::Vector3d(-dx, -dy, 1).normalized();
  const double light = normal.dot(Eigen::Vector3d(-0.5, 0.5, 0.7).normalized());
  return static_cast<uint8_t>(std::lround(60 + 175 * std::max(light, 0.0)));
}

double MeasuredArea(const ChangeRaster& raster) {
  double cells = 0;
  for (size_t i = 0; i < raster.before.size(); ++i) {
    cells += !std::isnan(raster.before.height_m[i]) && !std::isnan(raster.after.height_m[i]);
  }
  return cells * raster.cell_m() * raster.cell_m();
}

bool Inside(const Ring& ring, const Eigen::Vector2d& p) {
  bool inside = false;
  for (size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
    const Eigen::Vector2d &a = ring[i], &b = ring[j];
    if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y()) + a.x()) {
      inside = !inside;
    }
  }
  return inside;
}

}  // namespace

std::string ChangesJson(const ChangeReport& report) {
  Json json;
  json["tessera_changes"] = 1;
  json["scene"] = report.scene.name;
  json["coordinates"] = "scene";
  json["cell_m"] = report.raster.cell_m();
  json["gsd_m"] = Decimals(report.gsd_m, 4);
  json["measured_area_m2"] = Decimals(MeasuredArea(report.raster), 1);
  for (const ChangeKind kind : kChangeKinds) {
    int count = 0;
    double area_m2 = 0, volume_m3 = 0;
    for (const ChangeArea& area : report.areas) {
      if (area.kind != kind) continue;
      ++count;
      area_m2 += area.area_m2;
      volume_m3 += area.volume_m3;
    }
    json["totals"][ChangeKindName(kind)] = {
        {"count", count}, {"area_m2", Decimals(area_m2, 1)}, {"volume_m3", Decimals(volume_m3, 1)}};
  }
  const EpochDisagreement& disagreement = report.disagreement;
  json["disagreement"] = SharesJson(disagreement.before);
  json["disagreement"]["agreement"] = Decimals(disagreement.agreement, 3);
  json["disagreement"]["agreement_before"] = Decimals(disagreement.agreement_before, 3);
  json["disagreement"]["refined"] = disagreement.refined ? SharesJson(*disagreement.refined) : Json(nullptr);
  json["needs_mesh"] = std::count_if(report.areas.begin(), report.areas.end(),
                                     [](const ChangeArea& area) { return area.followed && !*area.followed; });
  json["areas"] = Json::array();
  for (size_t i = 0; i < report.areas.size(); ++i) {
    const ChangeArea& area = report.areas[i];
    const Eigen::Vector3d local = LocalPoint(report, area.place.x(), area.place.y(), area.place.z());
    const Eigen::Vector3d place = report.scene.frame.SceneFromLocal(local);
    Json one;
    one["id"] = i + 1;
    one["kind"] = ChangeKindName(area.kind);
    one["area_m2"] = Decimals(area.area_m2, 2);
    one["place"] = {Decimals(place.x(), 3), Decimals(place.y(), 3), Decimals(place.z(), 3)};
    if (const auto lon_lat = LonLat(report, local)) {
      one["lon_lat"] = {Decimals(lon_lat->x(), 8), Decimals(lon_lat->y(), 8)};
    }
    one["height_difference_m"] = Decimals(area.height_difference_m, 3);
    one["volume_m3"] = Decimals(area.volume_m3, 1);
    one["label_before"] = LabelName(report, area.label_before);
    one["label_after"] = LabelName(report, area.label_after);
    one["agreement"] = Decimals(area.agreement, 3);
    one["agreement_before"] = Decimals(area.agreement_before, 3);
    one["followed"] = Followed(area);
    if (area.followed && !*area.followed) {
      one["new_mesh"] = {{"box", SceneBox(report, area)}, {"outdated_faces", area.outdated_faces}};
    }
    one["rings"] = Json::array({SceneRing(report, area.outline.outer, area.place.z())});
    for (const Ring& hole : area.outline.holes) one["rings"].push_back(SceneRing(report, hole, area.place.z()));
    json["areas"].push_back(std::move(one));
  }
  return json.dump(1) + "\n";
}

std::string ChangesGeoJson(const ChangeReport& report) {
  Json json;
  json["type"] = "FeatureCollection";
  json["tessera_coordinates"] = IsGeographic(report) ? "wgs84" : "scene";
  json["features"] = Json::array();
  for (size_t i = 0; i < report.areas.size(); ++i) {
    const ChangeArea& area = report.areas[i];
    Json rings = Json::array({GeoRing(report, area.outline.outer, area.place.z())});
    for (const Ring& hole : area.outline.holes) rings.push_back(GeoRing(report, hole, area.place.z()));
    json["features"].push_back({{"type", "Feature"},
                                {"geometry", {{"type", "Polygon"}, {"coordinates", std::move(rings)}}},
                                {"properties",
                                 {{"id", i + 1},
                                  {"kind", ChangeKindName(area.kind)},
                                  {"area_m2", Decimals(area.area_m2, 2)},
                                  {"height_difference_m", Decimals(area.height_difference_m, 3)},
                                  {"volume_m3", Decimals(area.volume_m3, 1)},
                                  {"label_before", LabelName(report, area.label_before)},
                                  {"label_after", LabelName(report, area.label_after)},
                                  {"followed", Followed(area)}}}});
  }
  return json.dump(1) + "\n";
}

namespace {

// Bounding rectangle of the raster's cells with a surface; the first cell if there is none.
CellRect SurfacePart(const SurfaceRaster& raster) {
  CellRect part = {raster.width(), raster.height(), 0, 0};
  for (int y = 0; y < raster.height(); ++y) {
    for (int x = 0; x < raster.width(); ++x) {
      if (std::isnan(raster.height_m[static_cast<size_t>(y) * raster.width() + x])) continue;
      part = {std::min(part.x0, x), std::min(part.y0, y), std::max(part.x1, x + 1), std::max(part.y1, y + 1)};
    }
  }
  return part.x1 > part.x0 ? part : CellRect{0, 0, 1, 1};
}

}  // namespace

ByteImage DrawChanges(const ChangeReport& report, int max_side_px) {
  const SurfaceRaster& before = report.raster.before;
  const CellRect part = SurfacePart(before);
  const int side = std::max(part.x1 - part.x0, part.y1 - part.y0);
  const int px_per_cell = std::max(1, max_side_px / side);
  const int cells_per_px = std::max(1, (side + max_side_px - 1) / max_side_px);
  const auto pixels = [&](int cells) { return std::max(1, cells * px_per_cell / cells_per_px); };
  ByteImage image(pixels(part.x1 - part.x0), pixels(part.y1 - part.y0), 3, 255);
  const auto cell = [&](int pixel) { return pixel * cells_per_px / px_per_cell; };
  const auto set = [&](int px, int py, const std::array<uint8_t, 3>& color, double share) {
    for (int c = 0; c < 3; ++c) {
      uint8_t& value = image.at(px, image.height - 1 - py, c);
      value = static_cast<uint8_t>(std::lround(share * color[c] + (1 - share) * value));
    }
  };
  for (int py = 0; py < image.height; ++py) {
    for (int px = 0; px < image.width; ++px) {
      const int x = part.x0 + cell(px), y = part.y0 + cell(py);
      const size_t i = static_cast<size_t>(y) * before.width() + x;
      if (std::isnan(before.height_m[i])) continue;
      const uint8_t grey = Relief(before, x, y);
      // Fade cells that fewer than two views see.
      set(px, py, {grey, grey, grey}, std::isnan(report.raster.after.height_m[i]) ? 0.3 : 1);
    }
  }
  const double px_m = before.cell_m * cells_per_px / px_per_cell;
  const Eigen::Vector2d origin = Eigen::Vector2d(before.cells.x0 + part.x0, before.cells.y0 + part.y0) * before.cell_m;
  for (const ChangeArea& area : report.areas) {
    Eigen::AlignedBox2d box;
    for (const Eigen::Vector2d& p : area.outline.outer) box.extend(p);
    const Eigen::Vector2i low = ((box.min() - origin) / px_m).array().floor().cast<int>().max(0);
    const Eigen::Vector2i high = ((box.max() - origin) / px_m).array().ceil().cast<int>();
    for (int py = low.y(); py < std::min(high.y(), image.height); ++py) {
      for (int px = low.x(); px < std::min(high.x(), image.width); ++px) {
        const Eigen::Vector2d p = origin + Eigen::Vector2d(px + 0.5, py + 0.5) * px_m;
        bool inside = Inside(area.outline.outer, p);
        for (const Ring& hole : area.outline.holes) inside = inside && !Inside(hole, p);
        if (inside) set(px, py, KindColor(area.kind), 0.65);
      }
    }
  }
  std::vector<std::pair<std::string, std::array<uint8_t, 3>>> legend;
  for (const ChangeKind kind : kChangeKinds) {
    const auto count = std::count_if(report.areas.begin(), report.areas.end(),
                                     [&](const ChangeArea& area) { return area.kind == kind; });
    legend.push_back({absl::StrCat(ChangeKindName(kind), ": ", count), KindColor(kind)});
  }
  DrawLegend(&image, legend);
  return image;
}

Status WriteChangeReport(const ChangeReport& report, const std::string& folder) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/changes.json", ChangesJson(report)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/changes.geojson", ChangesGeoJson(report)));
  return WritePng(folder + "/changes.png", DrawChanges(report));
}

}  // namespace tessera

// The summary of a scene as text and JSON.
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "common/check/check.h"
#include "common/check/fit_findings.h"

namespace tessera {
namespace {

std::string AreaText(double m2) {
  return m2 >= 1e5 ? absl::StrFormat("%.3f km2", m2 / 1e6) : absl::StrFormat("%.1f m2", m2);
}

// Text from files may not be UTF-8.
std::string Written(const nlohmann::ordered_json& json) {
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace

std::string SummaryToText(const SceneSummary& s) {
  std::string text;
  const auto row = [&](const std::string& name, const std::string& value) {
    absl::StrAppend(&text, absl::StrFormat("%-14s ", name), value, "\n");
  };
  row("scene", s.name);
  row("coordinates", s.lat_deg ? absl::StrFormat("%s; centre at %.6f, %.6f", s.crs, *s.lat_deg, *s.lon_deg) : s.crs);
  std::string sizes;
  for (const SceneSummary::SizeCount& size : s.sizes) {
    absl::StrAppend(&sizes, sizes.empty() ? "" : ", ", size.images, " of ", size.width, " x ", size.height);
  }
  row("images", absl::StrCat(s.images, " (", sizes, ")"));
  if (!s.skipped.empty()) row("left out", absl::StrCat(s.skipped.size(), " images, missing or broken"));
  for (const SceneSummary::FlightCount& entry : s.flights) {
    row("flight", absl::StrCat(entry.flight.name, entry.flight.date.empty() ? "" : ", ", entry.flight.date, ": ",
                               entry.images, " images"));
  }
  row("likelihoods", s.has_likelihoods ? "yes" : "none: geometry only");
  row("GSD", absl::StrFormat("%.4f m", s.gsd_m));
  row("mesh", absl::StrCat(s.faces, " faces, ", s.vertices, " vertices", s.has_labels ? ", labelled" : ", no labels"));
  row("area", absl::StrCat(AreaText(s.surface_m2), " of surface on ", AreaText(s.extent_m2), " of ground"));
  for (const SceneSummary::ClassShare& entry : s.classes) {
    row("class", s.has_labels ? absl::StrFormat("%-12s %5.1f %% of the area, %d faces", entry.name,
                                                100 * entry.area_share, entry.faces)
                              : entry.name);
  }
  row("visibility", absl::StrFormat("%.1f %% of the faces in no view, %.1f %% in fewer than 3%s", 100 * s.unseen_share,
                                    100 * s.under_three_share,
                                    s.faces_tried < s.faces ? absl::StrCat(" (", s.faces_tried, " sampled)") : ""));
  if (s.fit) row("fit", FitText(*s.fit));
  if (!s.tie_points) {
    row("3D points", "none");
  } else {
    const TiePointFigures& points = *s.tie_points;
    row("3D points",
        absl::StrCat(points.observations > 0 ? absl::StrFormat("%d image points, median error %.2f px; ",
                                                               points.observations, points.median_px)
                                             : "no image points; ",
                     absl::StrFormat("%.1f %% of %d track entries inside their images", 100 * points.inside_share,
                                     points.track_entries),
                     points.from_mesh_m ? absl::StrFormat("; median distance from the mesh %.2f m, %+.2f m with sign",
                                                          *points.from_mesh_m, *points.above_mesh_m)
                                        : ""));
  }
  constexpr size_t kShownRows = 10;
  absl::StrAppend(&text, FitTableToText(s.fit_table, kShownRows));
  return text;
}

std::string SummaryToJson(const SceneSummary& s, const Warnings& warnings) {
  nlohmann::ordered_json json;
  json["name"] = s.name;
  json["crs"] = s.crs;
  if (s.lat_deg) json["centre"] = {{"lat_deg", *s.lat_deg}, {"lon_deg", *s.lon_deg}};
  json["images"] = s.images;
  json["skipped_images"] = nlohmann::ordered_json::array();
  for (const SkippedImage& image : s.skipped) {
    json["skipped_images"].push_back({{"name", image.name}, {"reason", image.reason}});
  }
  json["sizes"] = nlohmann::ordered_json::array();
  for (const auto& size : s.sizes) {
    json["sizes"].push_back({{"width_px", size.width}, {"height_px", size.height}, {"images", size.images}});
  }
  json["flights"] = nlohmann::ordered_json::array();
  for (const auto& entry : s.flights) {
    json["flights"].push_back({{"name", entry.flight.name}, {"date", entry.flight.date}, {"images", entry.images}});
  }
  json["has_likelihoods"] = s.has_likelihoods;
  json["gsd_m"] = s.gsd_m;
  json["vertices"] = s.vertices;
  json["faces"] = s.faces;
  json["surface_m2"] = s.surface_m2;
  json["extent_m2"] = s.extent_m2;
  json["has_labels"] = s.has_labels;
  json["unlabelled_faces"] = s.unlabelled_faces;
  json["classes"] = nlohmann::ordered_json::array();
  for (const auto& entry : s.classes) {
    json["classes"].push_back({{"name", entry.name}, {"faces", entry.faces}, {"area_share", entry.area_share}});
  }
  json["coverage"] = {
      {"faces_tried", s.faces_tried}, {"unseen_share", s.unseen_share}, {"under_three_share", s.under_three_share}};
  if (s.fit) {
    json["fit"] = nlohmann::ordered_json::parse(FitTableToJson(s.fit_table, s.fit_table.images.size()));
    const Eigen::Vector3d& shift_m = s.fit->mesh_shift_m;
    json["fit"]["mesh_shift_m"] = {shift_m.x(), shift_m.y(), shift_m.z()};
    json["fit"]["focal_changes"] = s.fit->focal_changes;
  }
  if (s.tie_points) {
    json["reprojection"] = {{"observations", s.tie_points->observations},
                            {"median_px", s.tie_points->median_px},
                            {"track_entries", s.tie_points->track_entries},
                            {"inside_share", s.tie_points->inside_share},
                            {"stale_images", s.tie_points->stale}};
    if (s.tie_points->from_mesh_m) {
      json["reprojection"]["from_mesh_m"] = *s.tie_points->from_mesh_m;
      json["reprojection"]["above_mesh_m"] = *s.tie_points->above_mesh_m;
    }
  }
  json["warnings"] = warnings;
  return Written(json);
}

std::string RefusalToJson(const Status& error, const Warnings& warnings) {
  nlohmann::ordered_json json;
  const std::vector<std::string> errors = absl::StrSplit(std::string(error.message()), '\n');
  json["errors"] = errors;
  json["warnings"] = warnings;
  return Written(json);
}

}  // namespace tessera

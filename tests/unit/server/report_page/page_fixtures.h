// report.json and job.json of a small job, for tests of report.html.
#pragma once

#include <gtest/gtest.h>

#include <pugixml.hpp>
#include <string>

namespace tessera {

inline constexpr char kPageReport[] = R"({
  "scene": "old town", "gsd_m": 0.125, "views": 50, "classes": ["ground", "roof"],
  "input": {"vertices": 63107, "faces": 125482}, "output": {"vertices": 125971, "faces": 251210},
  "displacement": {"rms_m": 0.6172, "median_m": 0.3925, "p90_m": 1.0003, "max_m": 3.1888},
  "label_changes": 42161,
  "area_share_before": {"ground": 0.7, "roof": 0.3}, "area_share_after": {"ground": 0.625, "roof": 0.375},
  "seams": {"samples": 14776, "different": 0, "farthest_m": 0.0, "tiles": []},
  "fit_change": {"patches": 5424, "above_chance_start": 0.9526, "above_chance_result": 0.9508, "worse": false},
  "skipped_images": [{"name": "0007.jpg", "reason": "no such file"}],
  "warnings": ["the poses are off by 2 px", "tile 1 is quarantined"],
  "tiles": [
    {"tile": 0, "faces": 117256, "views": 50, "labels_first": {"label_changes": 20942},
     "fit": {"patches": 2750, "above_chance_start": 0.95, "above_chance_result": 0.96},
     "rounds": [{"label_changes": 5816, "photo_energy_start": 0.0934, "photo_energy_end": 0.0871, "warped_pixels": 100},
                {"label_changes": 1351, "photo_energy_start": 0.0872, "photo_energy_end": 0.0870,
                 "warped_pixels": 90}]},
    {"tile": 1, "faces": 133954, "views": 49, "quarantined": true, "labels_first": {"label_changes": 19538},
     "rounds": [{"label_changes": 4365, "photo_energy_start": 0.0921, "photo_energy_end": 0.0854, "warped_pixels": 300},
                {"label_changes": 1508, "photo_energy_start": 0.0858, "photo_energy_end": 0.0852,
                 "warped_pixels": 90}]}]
})";

inline constexpr char kPageJob[] = R"({
 "tessera_job": 1, "name": "jobs/7", "display_name": "spring", "scene": "/srv/cities/old-town",
 "algorithm_version": "21", "base": "jobs/3",
 "settings": {"tiles": 2, "method": "tessera", "method_settings": {"semantic": 1.5, "levels": [2, 1, 0]}},
 "state": "partial", "error": "tile 1 is quarantined", "warnings": ["the poses are off by 2 px", "disk is slow"],
 "quarantined": [{"tile": 1, "why": "no memory"}],
 "totals": {"seconds": 253.0, "tasks": 160, "attempts": 161, "reused": 4},
 "tasks": [
  {"kind": "measure", "tile": 0, "predicted": {"core_seconds": 2.5, "peak_bytes": 314572800},
   "used": {"core_seconds": 3.0, "peak_bytes": 209715200}, "runs": [{"seconds": 4}]},
  {"kind": "measure", "tile": 1, "predicted": {"core_seconds": 1.5, "peak_bytes": 104857600},
   "used": {"core_seconds": 1.0, "peak_bytes": 0}, "runs": [{"seconds": 2}, {"seconds": 1}]},
  {"kind": "crop", "tile": 0, "reused": true, "predicted": {"core_seconds": 9}, "runs": []}
 ]
})";

// The page as XML. Fails the test if it is not well-formed.
inline pugi::xml_document ParsePage(const std::string& page) {
  pugi::xml_document document;
  const pugi::xml_parse_result result =
      document.load_string(page.c_str(), pugi::parse_default | pugi::parse_doctype | pugi::parse_ws_pcdata);
  EXPECT_TRUE(result) << result.description() << " at " << page.substr(static_cast<size_t>(result.offset), 100);
  return document;
}

// All text of the page outside of elements' names and attributes.
inline std::string PageText(const pugi::xml_document& document) {
  struct Walker : pugi::xml_tree_walker {
    std::string text;
    bool for_each(pugi::xml_node& node) override {
      text += node.value();
      return true;
    }
  } walker;
  pugi::xml_node body = document.child("html").child("body");
  body.traverse(walker);
  return walker.text;
}

}  // namespace tessera

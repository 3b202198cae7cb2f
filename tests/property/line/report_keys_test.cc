// report.json has the same keys for any tiling, so that its readers need not handle each tiling.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

// Adds the paths of all keys. The elements of an array share one path.
void AddKeys(const nlohmann::json& value, const std::string& path, std::set<std::string>* keys) {
  if (value.is_object()) {
    for (const auto& [key, item] : value.items()) {
      keys->insert(path + "/" + key);
      AddKeys(item, path + "/" + key, keys);
    }
  }
  if (value.is_array()) {
    for (const nlohmann::json& item : value) AddKeys(item, path + "/*", keys);
  }
}

std::set<std::string> KeysOf(const nlohmann::json& value) {
  std::set<std::string> keys;
  AddKeys(value, "", &keys);
  return keys;
}

nlohmann::json ReportOf(const std::string& folder, int tiles, const std::string& method) {
  JobSettings settings = {.tiles = tiles};
  settings.method = method;
  if (method != "labels") {
    settings.rounds = 2;
    settings.method_settings.levels = {1, 0};
    settings.method_settings.iterations = {2, 2};
  }
  const auto line = RunLine(folder, folder + "/" + method + std::to_string(tiles), settings);
  EXPECT_TRUE(line.ok()) << line.status();
  if (!line.ok()) return {};
  nlohmann::json report = nlohmann::json::parse(*ReadFile(line->back().output_dir + "/" + kReportFile));
  for (const char* list : {"worse_tiles", "worse_images"}) report.at("fit_change").at(list).clear();  // may be empty
  return report;
}

TEST(ReportKeys, AreTheSameForAnyTiling) {
  const std::string folder = FreshTestFolder("report_keys");
  WriteTinyScene(folder);
  for (const std::string method : {"tessera", "baseline", "labels"}) {
    const nlohmann::json whole = ReportOf(folder, 1, method), tiled = ReportOf(folder, 4, method);
    ASSERT_EQ(whole.at("tiles").size(), 1u);
    ASSERT_EQ(tiled.at("tiles").size(), 4u);
    EXPECT_EQ(KeysOf(whole), KeysOf(tiled)) << method;
    for (const nlohmann::json& tile : tiled.at("tiles")) {
      EXPECT_EQ(KeysOf(tile), KeysOf(whole.at("tiles").at(0))) << method;
      EXPECT_EQ(tile.at("rounds").size(), whole.at("tiles").at(0).at("rounds").size()) << method;
    }
  }
}

}  // namespace
}  // namespace tessera

// A coordinator with the fake planner and a fake scene; no network.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "server/store/sqlite_store.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {

class AdmissionFixture : public CoordinatorTest {
 protected:
  AdmissionFixture() {
    EXPECT_TRUE(EnsureFolder(scene_).ok());
    WriteScene("scene.json", "{}");
    WriteScene("image", std::string(2'500'000, 'i') + "end");
  }
  void WriteScene(const std::string& name, const std::string& content) {
    std::ofstream(scene_ + "/" + name, std::ios::binary) << content;
  }

  const std::string scene_ = folder_.path() + "/scene";
  std::unique_ptr<SqliteStore> cache_ = *SqliteStore::Open(folder_.path() + "/cache.sqlite");
};

}  // namespace tessera

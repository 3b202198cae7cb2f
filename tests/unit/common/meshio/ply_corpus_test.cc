// Replays the fuzzer's corpus: good_* are meshes, all others are not.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "tests/fuzz/ply_target.h"

namespace tessera {
namespace {

TEST(PlyCorpus, ReadsValidFilesAndRejectsInvalidOnes) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(TESSERA_SOURCE_DIR "/tests/fuzz/corpus/ply")) {
    files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  ASSERT_GE(files.size(), 10u);
  for (const std::filesystem::path& path : files) {
    std::ifstream file(path, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(file)), {});
    const bool good = path.filename().string().starts_with("good_");
    EXPECT_EQ(RunPlyTarget(bytes), good) << path;
    // The same through the file, whose window moves.
    EXPECT_EQ(ReadPly(path.string()).ok(), good) << path;
  }
}

}  // namespace
}  // namespace tessera

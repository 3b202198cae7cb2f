// Replays the fuzzer's corpus: files good_* are valid, all others invalid.
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
    // The same from a file, which is read through a window.
    EXPECT_EQ(ReadPly(path.string()).ok(), good) << path;
  }
}

}  // namespace
}  // namespace tessera

// main() of every test program: tests of one program run in several processes at once and name their files alike, so
// testing::TempDir() is a folder of this process. It is removed at the end; a test that is killed leaves it behind.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  std::string folder = testing::TempDir() + "tessera_test.XXXXXX";
  // Tests start programs as other users, too.
  if (mkdtemp(folder.data()) == nullptr || chmod(folder.c_str(), 0755) != 0 ||
      setenv("TEST_TMPDIR", folder.c_str(), 1) != 0) {
    std::perror(folder.c_str());
    return 1;
  }
  const int failed = RUN_ALL_TESTS();
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  return failed;
}

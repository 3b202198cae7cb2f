#include "common/storage/allowed_files.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <thread>

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// Folders root/scene and other are allowed; secret is not.
class AllowedFilesTest : public testing::Test {
 protected:
  AllowedFilesTest() {
    for (const char* name : {"root/scene", "other", "secret"}) fs::create_directories(Path(name));
    Write("root/scene/image", "an image");
    Write("other/image", "another image");
    Write("secret/key", "the secret");
  }
  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }
  void Write(const std::string& name, const std::string& content) const { std::ofstream(Path(name)) << content; }
  void Link(const std::string& name, const std::string& target) const { fs::create_symlink(target, Path(name)); }
  StatusOr<std::string> Read(const std::string& name) const { return allowed_.ReadWhole(Path(name), 1 << 20); }
  void ExpectRefused(const std::string& name, const std::string& found) const {
    const Status status = allowed_.Open(Path(name)).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << name << ": " << status;
    EXPECT_THAT(std::string(status.message()), AllOf(HasSubstr(found), Not(HasSubstr("the secret"))));
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  AllowedFiles allowed_ = [this] {
    for (const char* name : {"root", "other"}) fs::create_directories(Path(name));
    return *AllowedFiles::Under({Path("root"), Path("other")});
  }();
};

TEST_F(AllowedFilesTest, LinksBetweenAllowedFoldersAreFollowed) {
  Link("root/scene/inside", "image");
  Link("root/scene/elsewhere", Path("other/image"));
  Link("root/scene/up", "../../other/image");
  Link("root/scene/folder", Path("other"));
  EXPECT_EQ(*Read("root/scene/image"), "an image");
  EXPECT_EQ(*Read("root/scene/inside"), "an image");
  for (const char* name : {"elsewhere", "up", "folder/image"}) {
    EXPECT_EQ(*Read("root/scene/" + std::string(name)), "another image") << name;
  }
  EXPECT_EQ(allowed_.Open(Path("root/scene/none")).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(AllowedFilesTest, PathsOutsideAreRefusedWhetherTheyExistOrNot) {
  Link("root/scene/a", Path("secret/key"));
  Link("root/scene/b", Path("secret/none"));
  Link("root/scene/c", "../../secret/key");
  Link("root/scene/d", Path("secret"));
  Link("root/scene/e", "/etc/shadow");
  Link("root/scene/f", "/proc/self/environ");
  Link("root/scene/g", "/");
  for (const char* name : {"a", "b", "c", "d/key", "d/none", "e", "f", "g/etc/passwd", "../../secret/key"}) {
    ExpectRefused("root/scene/" + std::string(name), "a path outside the allowed folders");
    EXPECT_TRUE(allowed_.Exists(Path("root/scene/" + std::string(name))));
  }
  ExpectRefused("secret/key", "a path outside the allowed folders");
  ExpectRefused("secret/none", "a path outside the allowed folders");
  EXPECT_EQ(allowed_.IsFolder(Path("root/scene/d")).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(allowed_.Open("image").status().code(), absl::StatusCode::kInvalidArgument) << "relative";
  Link("root/scene/x", "y");
  Link("root/scene/y", "x");
  ExpectRefused("root/scene/x", "a link that cannot be resolved");
}

TEST_F(AllowedFilesTest, OnlyRegularFilesAreOpenedWithoutBlocking) {
  ASSERT_EQ(::mkfifo(Path("root/scene/pipe").c_str(), 0600), 0);
  ExpectRefused("root/scene/pipe", "a pipe");
  ExpectRefused("root/scene", "a folder");
  ExpectRefused("root/scene/two\nlines", "control characters");
  EXPECT_THAT(std::string(allowed_.Open(Path("root/scene/two\nlines")).status().message()), Not(HasSubstr("\n")));
  const auto all = *AllowedFiles::Under({"/"});
  EXPECT_THAT(std::string(all.Open("/dev/null").status().message()), HasSubstr("a device"));
  EXPECT_THAT(std::string(all.Open("/proc/self/environ").status().message()), HasSubstr("a pseudo file system"));
  EXPECT_TRUE(all.Open(Path("secret/key")).ok());
}

TEST_F(AllowedFilesTest, SpecialFilesAreRefusedInAllowedFoldersAndForTheirOwner) {
  const auto own = AllowedFiles::OwnedBy(::geteuid());
  const auto expect_refused = [&](const std::string& name, const std::string& found) {
    ExpectRefused(name, found);
    EXPECT_THAT(std::string(own.Open(Path(name)).status().message()), HasSubstr(found)) << name;
    EXPECT_FALSE(allowed_.ReadWhole(Path(name), 100).ok()) << name;
    EXPECT_FALSE(own.ReadWhole(Path(name), 100).ok()) << name;
  };
  ASSERT_EQ(::mkfifo(Path("root/scene/pipe").c_str(), 0600), 0);
  Link("root/scene/to_pipe", "pipe");
  expect_refused("root/scene/pipe", "a pipe");
  expect_refused("root/scene/to_pipe", "a pipe");
  const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un name = {};
  name.sun_family = AF_UNIX;
  const std::string path = Path("root/scene/socket");
  ASSERT_LT(path.size(), sizeof(name.sun_path));
  path.copy(name.sun_path, path.size());
  ASSERT_EQ(::bind(socket, reinterpret_cast<const sockaddr*>(&name), sizeof(name)), 0);
  expect_refused("root/scene/socket", "a socket");
  ::close(socket);
  expect_refused("root/scene/bell\a", "control characters");
  expect_refused("root/scene/no\xffutf8", "not UTF-8");
  for (const char* system : {"/proc/self/environ", "/proc/self/mem", "/sys/kernel/uevent_seqnum"}) {
    EXPECT_FALSE(own.Open(system).ok()) << system;
    EXPECT_FALSE(allowed_.Open(system).ok()) << system;
  }
  for (const char* device : {"/dev/null", "/dev/zero", "/dev/tty"}) EXPECT_FALSE(own.Open(device).ok()) << device;
  if (::mknod(Path("root/scene/zero").c_str(), S_IFCHR | 0600, ::makedev(1, 5)) == 0) {
    expect_refused("root/scene/zero", "a device");
  }
  Write("root/scene/two\nlines", "x");
  EXPECT_EQ(allowed_.List(Path("root/scene")).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(AllowedFilesTest, OpenDoesNotBlockOnAPipeThatReplacesTheFile) {
  ASSERT_EQ(::mkfifo(Path("root/scene/pipe").c_str(), 0600), 0);
  const std::string image = Path("root/scene/image"), pipe = Path("root/scene/pipe");
  const auto swap = [&] { return ::renameat2(AT_FDCWD, image.c_str(), AT_FDCWD, pipe.c_str(), RENAME_EXCHANGE) == 0; };
  if (!swap()) GTEST_SKIP() << "this file system does not support RENAME_EXCHANGE";
  std::atomic<bool> stop = false;
  std::thread swapper([&] {
    while (!stop) swap();
  });
  int opened = 0, refused = 0;
  for (int i = 0; i < 200'000 && (i < 20'000 || opened == 0 || refused == 0); ++i) {
    const auto file = allowed_.Open(image);
    ++(file.ok() ? opened : refused);
    if (file.ok()) {
      EXPECT_EQ(*file->Read(0, 100), "an image");
    }
  }
  stop = true;
  swapper.join();
  EXPECT_GT(opened, 0);
  EXPECT_GT(refused, 0);
}

TEST_F(AllowedFilesTest, LargeSparseFileIsRefused) {
  Write("root/scene/sparse", "x");
  ASSERT_EQ(::truncate(Path("root/scene/sparse").c_str(), off_t{1} << 36), 0);
  ExpectRefused("root/scene/sparse", "are on disk");
  if (::truncate(Path("root/scene/sparse").c_str(), (off_t{1} << 40) + 1) == 0) {
    ExpectRefused("root/scene/sparse", "expected at most");
  }
  Write("root/scene/small", "x");
  ASSERT_EQ(::truncate(Path("root/scene/small").c_str(), 1 << 20), 0);
  EXPECT_TRUE(allowed_.Open(Path("root/scene/small")).ok());
}

TEST_F(AllowedFilesTest, OwnedByAllowsOnlyFilesOfTheUser) {
  EXPECT_TRUE(AllowedFiles::OwnedBy(::geteuid()).Open(Path("secret/key")).ok());
  const Status others = AllowedFiles::OwnedBy(::geteuid() + 1).Open(Path("secret/key")).status();
  EXPECT_EQ(others.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(others.message()), HasSubstr("--scene-root"));
}

// An open file keeps its content when its path is replaced.
TEST_F(AllowedFilesTest, SwappedLinkDoesNotExposeOutsideFiles) {
  const AllowedFile held = *allowed_.Open(Path("root/scene/image"));
  fs::remove(Path("root/scene/image"));
  Link("root/scene/image", Path("secret/key"));
  EXPECT_EQ(*held.Read(0, 100), "an image");
  EXPECT_EQ(*ReadFile(held.path()), "an image");
  EXPECT_EQ(held.Hash({})->sha256, Sha256Hex("an image"));
  fs::remove(Path("root/scene/image"));
  // A folder becomes a link and back while files in it are opened.
  fs::create_directories(Path("root/scene/way"));
  Write("root/scene/way/key", "an image");
  Link("root/scene/trap", Path("secret"));
  const std::string way = Path("root/scene/way"), trap = Path("root/scene/trap");
  const auto swap = [&] { return ::renameat2(AT_FDCWD, way.c_str(), AT_FDCWD, trap.c_str(), RENAME_EXCHANGE) == 0; };
  if (!swap()) GTEST_SKIP() << "this file system does not support RENAME_EXCHANGE";
  std::atomic<bool> stop = false;
  std::thread swapper([&] {
    while (!stop) swap();
  });
  int opened = 0, refused = 0;
  for (int i = 0; i < 200'000 && (i < 20'000 || opened == 0 || refused == 0); ++i) {
    const auto file = allowed_.Open(Path("root/scene/way/key"));
    if (!file.ok()) {
      ++refused;
      continue;
    }
    ++opened;
    const std::string content = *file->Read(0, 100);
    EXPECT_EQ(content, "an image");
    if (content != "an image") break;
  }
  stop = true;
  swapper.join();
  EXPECT_GT(opened, 0);
  EXPECT_GT(refused, 0);
}

TEST_F(AllowedFilesTest, ListFollowsCircularLinksOnceAndRefusesOutsideOnes) {
  fs::create_directories(Path("root/scene/sub/deeper"));
  Write("root/scene/sub/deeper/b", "b");
  Link("root/scene/sub/again", "..");
  Link("root/scene/sub/more", ".");
  Link("root/scene/other", Path("other"));
  EXPECT_THAT(*allowed_.List(Path("root/scene")), ElementsAre("image", "other/image", "sub/deeper/b"));
  Link("root/scene/out", Path("secret"));
  EXPECT_EQ(allowed_.List(Path("root/scene")).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(AllowedFilesTest, AllowedFoldersMayBeLinks) {
  Link("short", Path("root"));
  const auto allowed = *AllowedFiles::Under({Path("short")});
  EXPECT_TRUE(allowed.Open(Path("short/scene/image")).ok());
  EXPECT_TRUE(allowed.Open(Path("root/scene/image")).ok());
  EXPECT_FALSE(allowed.Open(Path("other/image")).ok());
  EXPECT_EQ(AllowedFiles::Under({Path("none")}).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera

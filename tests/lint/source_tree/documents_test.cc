// Rules of the documents: pages stay short, their links lead somewhere, and the map names every folder with code.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace {

namespace fs = std::filesystem;

constexpr std::array<const char*, 3> kSides = {"common", "worker", "server"};
constexpr size_t kMaxSources = 26;  // .h and .cc files of a folder

size_t MostBytes(std::string_view page) {
  if (page == "README.md") return 10'240;
  if (page == "ARCHITECTURE.md") return 12'288;
  return 14'336;
}

std::string ReadAll(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// Paths from the project's root, sorted. Other folders beside the project's (builds, results) do not count.
std::vector<std::string> AllPages() {
  const fs::path root = TESSERA_SOURCE_DIR;
  std::vector<std::string> pages;
  const auto add = [&](const fs::path& path) {
    if (path.extension() == ".md") pages.push_back(fs::relative(path, root).generic_string());
  };
  for (const auto& entry : fs::directory_iterator(root)) add(entry.path());
  for (const char* folder : {"common", "deploy", "proto", "server", "tests", "worker"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) add(entry.path());
  }
  std::sort(pages.begin(), pages.end());
  return pages;
}

// The page without what stands between lines of ``` or between single `.
std::string WithoutCode(const std::string& text) {
  std::istringstream lines(text);
  std::string line, prose;
  bool in_block = false;
  while (std::getline(lines, line)) {
    if (line.starts_with("```")) {
      in_block = !in_block;
    } else if (!in_block) {
      prose += line + "\n";
    }
  }
  return std::regex_replace(prose, std::regex("`[^`\n]*`"), "");
}

// Targets of links and pictures that are paths, without the part after #.
std::vector<std::string> LinkedPaths(const std::string& text) {
  static const std::regex kLink(R"(\]\(([^)\s]+)\))");
  const std::string prose = WithoutCode(text);
  std::vector<std::string> paths;
  for (std::sregex_iterator it(prose.begin(), prose.end(), kLink), end; it != end; ++it) {
    const std::string target = (*it)[1].str();
    if (target.find("://") != std::string::npos || target.starts_with("mailto:")) continue;
    const std::string path = target.substr(0, target.find('#'));
    if (!path.empty()) paths.push_back(path);
  }
  return paths;
}

bool HasRow(const std::string& map, const std::string& folder) {
  return map.find("\n| `" + folder + "` |") != std::string::npos;
}

TEST(Documents, AreShort) {
  for (const std::string& page : AllPages()) {
    EXPECT_LE(fs::file_size(fs::path(TESSERA_SOURCE_DIR) / page), MostBytes(page)) << page;
  }
}

TEST(Documents, LinksLeadToFiles) {
  const fs::path root = TESSERA_SOURCE_DIR;
  for (const std::string& page : AllPages()) {
    const fs::path folder = (root / page).parent_path();
    for (const std::string& path : LinkedPaths(ReadAll(root / page))) {
      EXPECT_TRUE(fs::exists(folder / path)) << page << ": the link to " << path << " leads nowhere";
    }
  }
}

TEST(Documents, TheMapNamesEveryFolder) {
  const fs::path root = TESSERA_SOURCE_DIR;
  const std::string map = ReadAll(root / "ARCHITECTURE.md");
  for (const char* side : kSides) {
    for (const auto& entry : fs::directory_iterator(root / side)) {
      if (!fs::exists(entry.path() / "CMakeLists.txt")) continue;
      const std::string folder = std::string(side) + "/" + entry.path().filename().string();
      EXPECT_TRUE(HasRow(map, folder)) << "ARCHITECTURE.md has no row for " << folder;
    }
  }
}

TEST(Folders, AreSmall) {
  const fs::path root = TESSERA_SOURCE_DIR;
  std::map<std::string, size_t> sources;
  for (const char* side : kSides) {
    for (const auto& entry : fs::recursive_directory_iterator(root / side)) {
      const std::string extension = entry.path().extension().string();
      if (!entry.is_regular_file() || (extension != ".h" && extension != ".cc")) continue;
      ++sources[fs::relative(entry.path().parent_path(), root).generic_string()];
    }
  }
  for (const auto& [folder, count] : sources) EXPECT_LE(count, kMaxSources) << folder;
}

// The rules themselves.

TEST(DocumentRules, FindLinks) {
  EXPECT_EQ(LinkedPaths("[a](b.md) ![p](c/d.png) [e](f.md#g) [h](#i)\n"),
            (std::vector<std::string>{"b.md", "c/d.png", "f.md"}));
  EXPECT_TRUE(LinkedPaths("[a](https://b.c) [d](mailto:e) `[f](g.md)`\n```\n[h](i.md)\n```\n").empty());
}

TEST(DocumentRules, FindRows) {
  EXPECT_TRUE(HasRow("| folder |\n| `common/base` | status |\n", "common/base"));
  EXPECT_FALSE(HasRow("common/base\n| `common/baseline` | |\n", "common/base"));
}

TEST(DocumentRules, FindPages) {
  EXPECT_GE(AllPages().size(), 10u);
  EXPECT_EQ(MostBytes("README.md"), 10'240u);
  EXPECT_EQ(MostBytes("server/README.md"), 14'336u);
}

}  // namespace

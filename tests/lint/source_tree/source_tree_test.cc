// Rules of the source tree that no compiler checks: heavy headers stay in .cc files, modules use only what is below
// them, files are short and named for what they hold.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxLines = 500;

struct Include {
  size_t line = 0;
  std::string path;
};

struct SourceFile {
  std::string path;  // from the project's root, with slashes
  size_t lines = 0;
  std::vector<Include> includes;
};

SourceFile Scan(std::istream& text, const std::string& path) {
  static const std::regex pattern(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"].*)");
  SourceFile file{path, 0, {}};
  std::string line;
  while (std::getline(text, line)) {
    ++file.lines;
    std::smatch match;
    if (line.find("include") != std::string::npos && std::regex_match(line, match, pattern)) {
      file.includes.push_back({file.lines, match[1].str()});
    }
  }
  return file;
}

std::vector<SourceFile> AllSources() {
  std::vector<SourceFile> files;
  const fs::path root = TESSERA_SOURCE_DIR;
  for (const char* folder : {"common", "worker", "server", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (!entry.is_regular_file() || (extension != ".h" && extension != ".cc")) continue;
      std::ifstream text(entry.path());
      files.push_back(Scan(text, fs::relative(entry.path(), root).generic_string()));
    }
  }
  std::sort(files.begin(), files.end(), [](const SourceFile& a, const SourceFile& b) { return a.path < b.path; });
  return files;
}

// The folders that `folder`/CMakeLists.txt adds, in its order, which is that of dependence.
std::vector<std::string> ModulesInOrder(const std::string& folder) {
  static const std::regex pattern(R"(^\s*add_subdirectory\(\s*(\w+)\s*\).*)");
  std::ifstream text(fs::path(TESSERA_SOURCE_DIR) / folder / "CMakeLists.txt");
  std::vector<std::string> modules;
  std::string line;
  std::smatch match;
  while (std::getline(text, line)) {
    if (std::regex_match(line, match, pattern)) modules.push_back(match[1].str());
  }
  return modules;
}

// The first `parts` folders of a path; empty if it has fewer.
std::string Folder(const std::string& path, int parts) {
  size_t end = 0;
  for (int i = 0; i < parts; ++i) {
    end = path.find('/', end == 0 ? 0 : end + 1);
    if (end == std::string::npos) return "";
  }
  return path.substr(0, end);
}

using Faults = std::vector<std::string>;

std::string At(const SourceFile& file, const Include& include) {
  return file.path + ":" + std::to_string(include.line) + ": includes " + include.path;
}

Faults HeavyHeaders(const std::vector<SourceFile>& files) {
  constexpr std::array kHeavy = {"CGAL/",   "opencv2/",  "grpcpp/", "OpenMesh/",  "embree3/",
                                 "spdlog/", "nlohmann/", "CLI/",    "prometheus/"};
  Faults faults;
  for (const SourceFile& file : files) {
    if (!file.path.ends_with(".h") || Folder(file.path, 1) == "tests") continue;
    for (const Include& include : file.includes) {
      if (std::any_of(kHeavy.begin(), kHeavy.end(), [&](const char* p) { return include.path.starts_with(p); })) {
        faults.push_back(At(file, include) + ", which belongs into a .cc file");
      }
    }
  }
  return faults;
}

Faults UpwardIncludes(const std::vector<SourceFile>& files, const std::map<std::string, int>& rank) {
  Faults faults;
  for (const SourceFile& file : files) {
    const std::string side = Folder(file.path, 1);
    if (side == "tests") continue;
    const std::string own_module = Folder(file.path, 2);
    for (const Include& include : file.includes) {
      const std::string other_side = Folder(include.path, 1);
      const std::string other_module = Folder(include.path, 2);
      if (other_side == "tests") {
        faults.push_back(At(file, include) + ", a test's");
      } else if (other_side == "worker" || other_side == "server") {
        if (other_side != side) faults.push_back(At(file, include) + ", from " + side + " to " + other_side);
      }
      // Among the modules of one folder, whoever comes first in its CMakeLists.txt is below.
      if (other_side != side || other_module == own_module) continue;
      const auto own = rank.find(own_module), other = rank.find(other_module);
      if (own == rank.end() || other == rank.end()) {
        faults.push_back(At(file, include) + ", of a module that CMakeLists.txt does not name");
      } else if (other->second > own->second) {
        faults.push_back(At(file, include) + ", a module above its own");
      }
    }
  }
  return faults;
}

Faults LongFiles(const std::vector<SourceFile>& files) {
  Faults faults;
  for (const SourceFile& file : files) {
    if (file.lines > kMaxLines) faults.push_back(file.path + ": " + std::to_string(file.lines) + " lines");
  }
  return faults;
}

Faults VagueNames(const std::vector<SourceFile>& files) {
  static const std::regex pattern(R"((.*_)?(utils?|helpers?|misc|managers?)(_.*)?\.(h|cc))");
  Faults faults;
  for (const SourceFile& file : files) {
    if (std::regex_match(fs::path(file.path).filename().string(), pattern)) faults.push_back(file.path);
  }
  return faults;
}

std::map<std::string, int> ModuleRanks() {
  std::map<std::string, int> rank;
  for (const char* side : {"common", "worker", "server"}) {
    int next = 0;
    for (const std::string& module : ModulesInOrder(side)) rank[std::string(side) + "/" + module] = next++;
  }
  return rank;
}

std::string Lines(const Faults& faults) {
  std::string text;
  for (const std::string& fault : faults) text += "\n  " + fault;
  return text;
}

TEST(SourceTree, HeadersAreLight) {
  const Faults faults = HeavyHeaders(AllSources());
  EXPECT_TRUE(faults.empty()) << Lines(faults);
}

TEST(SourceTree, IncludesGoDown) {
  const Faults faults = UpwardIncludes(AllSources(), ModuleRanks());
  EXPECT_TRUE(faults.empty()) << Lines(faults);
}

TEST(SourceTree, FilesAreShort) {
  const Faults faults = LongFiles(AllSources());
  EXPECT_TRUE(faults.empty()) << Lines(faults);
}

TEST(SourceTree, NamesSayWhatFilesHold) {
  const Faults faults = VagueNames(AllSources());
  EXPECT_TRUE(faults.empty()) << Lines(faults);
}

// The rules themselves.

SourceFile Made(const std::string& path, const std::string& text) {
  std::istringstream stream(text);
  return Scan(stream, path);
}

TEST(SourceTreeRules, FindWhatTheyForbid) {
  const std::map<std::string, int> rank = {
      {"common/base", 0}, {"common/scene", 1}, {"worker/tasks", 0}, {"server/plan", 0}, {"server/api", 1}};
  const auto faults = [&](const std::string& path, const std::string& text) {
    const std::vector<SourceFile> files = {Made(path, text)};
    return HeavyHeaders(files).size() + UpwardIncludes(files, rank).size();
  };
  EXPECT_EQ(faults("common/scene/a.h", "#include <CGAL/x.h>\n"), 1u);
  EXPECT_EQ(faults("common/scene/a.h", "  #  include \"opencv2/core.hpp\"  // why\n"), 1u);
  EXPECT_EQ(faults("common/scene/a.cc", "#include <CGAL/x.h>\n"), 0u);
  EXPECT_EQ(faults("tests/a.h", "#include <CGAL/x.h>\n"), 0u);
  EXPECT_EQ(faults("common/scene/a.cc", "#include \"common/base/b.h\"\n#include \"common/scene/b.h\"\n"), 0u);
  EXPECT_EQ(faults("common/base/a.cc", "#include \"common/scene/b.h\"\n"), 1u);
  EXPECT_EQ(faults("common/base/a.cc", "#include \"common/nowhere/b.h\"\n"), 1u);
  EXPECT_EQ(faults("common/base/a.cc", "#include \"server/plan/b.h\"\n"), 1u);
  EXPECT_EQ(faults("worker/tasks/a.cc", "#include \"server/plan/b.h\"\n#include \"common/scene/b.h\"\n"), 1u);
  EXPECT_EQ(faults("server/plan/a.cc", "#include \"worker/tasks/b.h\"\n"), 1u);
  EXPECT_EQ(faults("server/plan/a.cc", "#include \"server/api/b.h\"\n"), 1u);
  EXPECT_EQ(faults("server/api/a.cc", "#include \"server/plan/b.h\"\n"), 0u);
  EXPECT_EQ(faults("server/api/a.cc", "#include \"tests/b.h\"\n"), 1u);
  EXPECT_EQ(LongFiles({Made("a.cc", std::string(501, '\n'))}).size(), 1u);
  EXPECT_EQ(LongFiles({Made("a.cc", std::string(500, '\n'))}).size(), 0u);
  for (const char* name : {"a/utils.h", "a/mesh_util.cc", "a/helpers.cc", "a/misc.h", "a/tile_manager.cc"}) {
    EXPECT_EQ(VagueNames({Made(name, "")}).size(), 1u) << name;
  }
  EXPECT_EQ(VagueNames({Made("a/utility_lines.h", "")}).size(), 0u);
  EXPECT_GE(AllSources().size(), 20u);
  EXPECT_GE(ModuleRanks().size(), 10u);
}

}  // namespace

// Classes do one job: few public methods, defined in few files.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

constexpr int kMaxPublicMethods = 20;
constexpr size_t kMaxFilesOfClass = 2;

// The code without comments, preprocessor lines and the contents of literals.
std::string Stripped(const std::string& code) {
  std::string out;
  for (size_t i = 0; i < code.size();) {
    const bool line_starts = out.empty() || out.back() == '\n';
    if (code.compare(i, 2, "//") == 0 || (line_starts && code[i] == '#')) {
      while (i < code.size() && code[i] != '\n') i += code[i] == '\\' ? 2 : 1;
    } else if (code.compare(i, 2, "/*") == 0) {
      i = std::min(code.find("*/", i), code.size() - 2) + 2;
    } else if (code.compare(i, 3, "R\"(") == 0) {
      i = std::min(code.find(")\"", i), code.size() - 2) + 2;
    } else if (code[i] == '"' ||
               (code[i] == '\'' && (i == 0 || !std::isalnum(static_cast<unsigned char>(code[i - 1]))))) {
      const char quote = code[i++];
      while (i < code.size() && code[i] != quote) i += code[i] == '\\' ? 2 : 1;
      ++i;
    } else {
      out += code[i++];
    }
  }
  return out;
}

// The statement without what stands in <...>, but for the < of operators.
std::string WithoutTemplateArguments(const std::string& statement) {
  std::string out;
  int depth = 0;
  for (size_t i = 0; i < statement.size(); ++i) {
    const char c = statement[i];
    if (c == '<' && !out.ends_with("operator") && !out.ends_with("operator<")) {
      ++depth;
    } else if (c == '>' && depth > 0) {
      --depth;
    } else if (depth == 0) {
      out += c;
    }
  }
  return out;
}

// Whether a member's declaration, up to its ; or {, is that of a function that somebody wrote. The number of overrides
// is that of the interface, which is counted.
bool IsMethod(const std::string& statement) {
  static const std::regex other(R"(^\s*(using|friend|typedef|static_assert|enum|class|struct|template\s*class)\b)");
  static const std::regex not_written(R"((=\s*(delete|default)|\boverride)\s*$)");
  if (std::regex_search(statement, other) || std::regex_search(statement, not_written)) return false;
  const std::string plain = WithoutTemplateArguments(statement);
  const size_t parenthesis = plain.find('(');
  if (parenthesis == std::string::npos) return false;
  return plain.find('=') > parenthesis || plain.find("operator") < parenthesis;
}

// Counts public methods of the classes in `code`, by name (Outer::Inner).
class PublicMethods {
 public:
  explicit PublicMethods(const std::string& code) : code_(Stripped(code)) { Scope("", true, false); }
  const std::map<std::string, int>& counts() const { return counts_; }

 private:
  // Up to the brace that closes the scope. `in_class`: the class of that name, else a namespace.
  void Scope(const std::string& name, bool is_public, bool in_class) {
    static const std::regex section(R"(^\s*(public|private|protected)\s*$)");
    static const std::regex type(
        R"((?:^|\s)(class|struct)\s+(?:alignas\([^)]*\)\s*)?(\w+)\s*(?:final\s*)?(?::[^:].*)?$)");
    static const std::regex space(R"(^\s*(inline\s+)?namespace\b[^=]*$)");
    std::string statement;
    std::smatch match;
    while (at_ < code_.size()) {
      const char c = code_[at_++];
      if (c == '}') return;
      if (c == ';') {
        Count(name, is_public && in_class && IsMethod(statement));
        statement.clear();
      } else if (c == ':' && in_class && std::regex_match(statement, match, section) && code_[at_] != ':') {
        is_public = match[1] == "public";
        statement.clear();
      } else if (c == '{') {
        const bool is_data = statement.find('=') != std::string::npos || statement.find('(') != std::string::npos;
        if (!is_data && std::regex_search(statement, space)) {
          Scope(name, true, false);
          statement.clear();
        } else if (!is_data && !statement.starts_with("enum") && std::regex_search(statement, match, type)) {
          const std::string inner = (in_class ? name + "::" : "") + match[2].str();
          const bool starts_public = match[1] == "struct";
          Scope(inner, starts_public, true);
          statement.clear();
        } else {
          Skip();
          const size_t next = code_.find_first_not_of(" \t\n", at_);
          const bool method = in_class && IsMethod(statement);
          // An initializer in braces may be followed by others, and by the body.
          if (next != std::string::npos && (code_[next] == ',' || code_[next] == '{' || code_[next] == ';')) continue;
          if (next != std::string::npos && in_class && !method) continue;
          Count(name, is_public && method);
          statement.clear();
        }
      } else if (!std::isspace(static_cast<unsigned char>(c))) {
        statement += c;
      } else if (!statement.empty() && statement.back() != ' ') {
        statement += ' ';
      }
    }
  }
  void Skip() {
    for (int depth = 1; at_ < code_.size() && depth > 0; ++at_)
      depth += code_[at_] == '{' ? 1 : code_[at_] == '}' ? -1 : 0;
  }
  void Count(const std::string& name, bool counts) {
    if (counts) ++counts_[name];
  }

  const std::string code_;
  size_t at_ = 0;
  std::map<std::string, int> counts_;
};

// The classes whose members a .cc file defines: Outer::Inner of "Status Outer::Inner::Run(".
std::set<std::string> ClassesDefinedIn(const std::string& code) {
  static const std::regex member(R"(^(?:[\w:<>,&*\s]*?[\s&*>])?((?:\w+::)+)(~?\w+|operator\W+)\()");
  std::set<std::string> classes;
  std::istringstream lines(Stripped(code));
  std::smatch match;
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || std::isspace(static_cast<unsigned char>(line[0]))) continue;
    if (!std::regex_search(line, match, member)) continue;
    std::string name = match[1].str();
    classes.insert(name.substr(0, name.size() - 2));
  }
  return classes;
}

std::string Read(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

template <class Visit>
void ForEachSource(const std::string& extension, const Visit& visit) {
  for (const char* folder : {"common", "worker", "server"}) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(TESSERA_SOURCE_DIR) / folder)) {
      if (entry.is_regular_file() && entry.path().extension() == extension) visit(entry.path());
    }
  }
}

TEST(ClassRules, ClassesHaveFewPublicMethods) {
  int classes = 0;
  ForEachSource(".h", [&](const fs::path& path) {
    const PublicMethods methods(Read(path));
    for (const auto& [name, count] : methods.counts()) {
      ++classes;
      EXPECT_LE(count, kMaxPublicMethods) << path << ": " << name;
    }
  });
  EXPECT_GE(classes, 50);
}

TEST(ClassRules, AClassIsDefinedInFewFiles) {
  std::map<std::string, std::set<std::string>> files;  // of "folder Class"
  ForEachSource(".cc", [&](const fs::path& path) {
    for (const std::string& name : ClassesDefinedIn(Read(path))) {
      files[path.parent_path().string() + " " + name].insert(path.filename().string());
    }
  });
  for (const auto& [name, in] : files)
    EXPECT_LE(in.size(), kMaxFilesOfClass) << name << ": " << testing::PrintToString(in);
  EXPECT_GE(files.size(), 50u);
}

// The rules themselves.

int CountOf(const std::string& code, const std::string& name) {
  const PublicMethods methods(code);
  const auto found = methods.counts().find(name);
  return found == methods.counts().end() ? 0 : found->second;
}

TEST(ClassRules, CountDeclarationsInPublicSections) {
  const std::string code = R"code(
#define OPEN {
namespace tessera {
class Forward;
enum class Kind { kA, kB };
// void Comment();
class A final : public Base, private Other<int> {
 public:
  using Done = std::function<void(int)>;
  A(int a, int b) : a_(a), b_{b}, text_("}") {}
  A(const A&) = delete;
  A& operator=(const A&) = delete;
  ~A() = default;
  friend bool operator==(const A&, const A&);
  std::map<int, std::function<void()>> Map() const { return {}; }
  static StatusOr<std::unique_ptr<A>> Open(const std::string& path,
                                           Options options = {});
  virtual void Run() = 0;
  void Stop() override;
  int Size() const override { return 1; }
  bool operator<(const A& other) const { return a_ < other.a_; }
  template <class T>
  void Visit(const T& visit) {
    if (true) { visit(a_); }
  }
  std::function<void(int)> callback = {};
  int value = Default(3);
  std::atomic<bool> flag{false};
  struct Inner {
    int x = 0;
    int Sum() const { return x; }
    void Add();
  };
  class Hidden {
    void Not();
   public:
    void Seen();
  };

 protected:
  void Protected();

 private:
  void Private();
  int a_ = 0, b_ = 0;
};
struct Plain {
  int x = 0;
};
struct HasMethods {
  void One();
};
void Free();
inline int Inline() { return 1; }
}  // namespace tessera
)code";
  EXPECT_EQ(CountOf(code, "A"), 6);  // constructor, Map, Open, Run, operator<, Visit
  EXPECT_EQ(CountOf(code, "A::Inner"), 2);
  EXPECT_EQ(CountOf(code, "A::Hidden"), 1);
  EXPECT_EQ(CountOf(code, "Plain"), 0);
  EXPECT_EQ(CountOf(code, "HasMethods"), 1);
  EXPECT_EQ(CountOf(code, ""), 0);
}

TEST(ClassRules, FindTheClassesThatAFileDefines) {
  const auto classes = ClassesDefinedIn(
      "namespace tessera {\n"
      "A::A(int x) : x_(x) {}\n"
      "StatusOr<std::vector<int>> B::Inner::List(const std::string& name) const {\n"
      "  return C::Make(1);\n"
      "}\n"
      "D::~D() { E::End(); }\n"
      "// F::Comment() {}\n"
      "std::string Free(int x) { return G::Text(x); }\n"
      "bool H::operator==(const H& other) const { return true; }\n");
  EXPECT_EQ(classes, (std::set<std::string>{"A", "B::Inner", "D", "H"}));
}

}  // namespace

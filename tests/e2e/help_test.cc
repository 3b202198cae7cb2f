// Help texts: every command of the programs begins with an imperative sentence and shows an example.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <sstream>
#include <string>
#include <vector>

#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

using testing::HasSubstr;

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

// Names and first help lines of the subcommands that a help text lists under its group headings.
std::vector<std::pair<std::string, std::string>> Listed(const std::string& help,
                                                        const std::vector<std::string>& groups) {
  std::vector<std::pair<std::string, std::string>> listed;
  bool in_group = false;
  for (const std::string& line : Lines(help)) {
    if (!line.starts_with("  ")) {
      in_group = std::find(groups.begin(), groups.end(), line) != groups.end();
    } else if (in_group) {
      const size_t end = line.find(' ', 2);
      listed.emplace_back(line.substr(2, end - 2), line.substr(line.find_first_not_of(' ', end)));
    }
  }
  return listed;
}

bool IsUpper(char c) { return std::isupper(static_cast<unsigned char>(c)) != 0; }

// One short sentence that begins with a verb in the imperative: "Submit", not "Submits" or "Coordinator".
void ExpectImperative(const std::string& line) {
  static const std::vector<std::string> kVerbs = {"Cancel",  "Change",   "Check",  "Compute", "Coordinate", "Create",
                                                  "Delete",  "Download", "List",   "Make",    "Measure",    "Pause",
                                                  "Predict", "Refine",   "Render", "Restore", "Resume",     "Retry",
                                                  "Revoke",  "Run",      "Show",   "Submit",  "Upload"};
  const std::string verb = line.substr(0, line.find(' '));
  EXPECT_THAT(kVerbs, testing::Contains(verb)) << line;
  EXPECT_LE(line.size(), 80u) << line;
  EXPECT_EQ(line.find_first_of(".;:"), std::string::npos) << line;
}

// `help`: of `command`, such as "tessera submit".
void ExpectPlainHelp(const std::string& command, const std::string& help) {
  SCOPED_TRACE(command);
  const std::vector<std::string> lines = Lines(help);
  ASSERT_FALSE(lines.empty());
  ExpectImperative(lines.front());
  EXPECT_THAT(help, HasSubstr("\n  " + command + " "));
  // Option texts stand in the help's second column.
  constexpr size_t kColumn = 30;
  for (const std::string& line : lines) {
    const bool is_text = line.size() > kColumn && line.substr(kColumn - 2, 2) == "  " && line[kColumn] != ' ';
    const bool is_option = line.starts_with("  -") || line.find_first_not_of(' ') == kColumn;
    if (!is_text || !is_option) continue;
    EXPECT_TRUE(IsUpper(line[kColumn])) << line;
  }
}

std::string HelpOf(const std::string& program, std::vector<std::string> arguments) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  arguments.push_back("--help");
  const Outcome outcome = Program(folder.path(), program, arguments).Wait();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  return outcome.output;
}

TEST(HelpTest, EveryCommandIsImperativeWithAnExample) {
  const std::string help = HelpOf(TESSERA_PROGRAM, {});
  const auto commands = Listed(help, {"Scene:", "Jobs:", "Cluster:", "Data:"});
  EXPECT_EQ(commands.size(), 26u);
  for (const auto& [name, line] : commands) {
    ExpectImperative(line);
    const std::string of_command = HelpOf(TESSERA_PROGRAM, {name});
    ExpectPlainHelp("tessera " + name, of_command);
    for (const auto& [action, action_line] : Listed(of_command, {"Subcommands:"})) {
      ExpectImperative(action_line);
      ExpectPlainHelp("tessera " + name + " " + action, HelpOf(TESSERA_PROGRAM, {name, action}));
    }
  }
  ExpectPlainHelp("tesserad", HelpOf(TESSERAD_PROGRAM, {}));
  ExpectPlainHelp("tessera-worker", HelpOf(TESSERA_WORKER_PROGRAM, {}));
}

TEST(HelpTest, NoArgumentsShowFiveCommands) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const Outcome outcome = Program(folder.path(), TESSERA_PROGRAM, {}).Wait();
  EXPECT_EQ(outcome.exit_code, 2);
  const std::vector<std::string> lines = Lines(outcome.output);
  EXPECT_EQ(
      std::count_if(lines.begin(), lines.end(), [](const std::string& line) { return line.starts_with("  tessera "); }),
      5);
  EXPECT_THAT(outcome.output, HasSubstr("tessera --help"));
}

}  // namespace
}  // namespace tessera::e2e

// Servers that ctest starts once for all tests (fixtures of tests/support/servers): their addresses, or a skipped test.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

namespace tessera {

// What the script start-NAME wrote to `file` ("address", "missing"), without the last line end; empty if nothing.
// ctest sets TESSERA_TEST_SERVERS; by hand: start-NAME DIR/NAME, then TESSERA_TEST_SERVERS=DIR.
inline std::string ServerFile(const std::string& name, const std::string& file) {
  const char* const folder = std::getenv("TESSERA_TEST_SERVERS");
  if (folder == nullptr) return "";
  std::ostringstream content;
  content << std::ifstream(std::string(folder) + "/" + name + "/" + file).rdbuf();
  std::string text = content.str();
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

// Empty if the server does not run.
inline std::string ServerAddress(const std::string& name) { return ServerFile(name, "address"); }

inline std::string WhyNoServer(const std::string& name) {
  const std::string missing = ServerFile(name, "missing");
  return missing.empty() ? name + " is not started: run the test by ctest" : missing;
}

// TESSERA_REQUIRE_SERVERS=1: a test without its server fails.
inline bool ServersAreRequired() {
  const char* const required = std::getenv("TESSERA_REQUIRE_SERVERS");
  return required != nullptr && std::string(required) == "1";
}

}  // namespace tessera

// First in a test or in SetUp: skips the test if the server does not run.
#define TESSERA_NEED_SERVER(name)                                                \
  do {                                                                           \
    if (!::tessera::ServerAddress(name).empty()) break;                          \
    if (::tessera::ServersAreRequired()) FAIL() << ::tessera::WhyNoServer(name); \
    GTEST_SKIP() << ::tessera::WhyNoServer(name);                                \
  } while (false)

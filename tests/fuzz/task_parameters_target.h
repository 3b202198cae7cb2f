// Parameters of tasks, as JSON: the first byte says of which kind, a letter from 'a' on.
#pragma once

#include <string>

#include "common/exporting/export_parameters.h"
#include "common/job/task_parameters.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if they were taken.
inline bool RunTaskParametersTarget(const std::string& bytes) {
  if (bytes.empty()) return false;
  const std::string json = bytes.substr(1);
  const auto check = [&](const auto& parse) {
    const auto parsed = parse(json);
    if (!parsed.ok()) {
      RequireRefusal(parsed.status());
      return false;
    }
    const std::string text = ToJson(*parsed);
    const auto again = parse(text);
    Require(again.ok() && ToJson(*again) == text, "what is written is read as it was");
    return true;
  };
  switch (bytes[0]) {
    case 'a':
      return check(ParseIngestParameters);
    case 'b':
      return check(ParseUpdateParameters);
    case 'c':
      return check(ParseUpdateFiles);
    case 'd':
      return check(ParseCutParameters);
    case 'e':
      return check(ParseStartParameters);
    case 'f':
      return check(ParseRefineParameters);
    case 'g':
      return check(ParseStepParameters);
    case 'h':
      return check(ParseCompareParameters);
    case 'i':
      return check(ParseChangesParameters);
    case 'j':
      return check(ParsePublishParameters);
    case 'k':
      return check(ParseMethodSettings);
    case 'l':
      return check(ParseClassifyParameters);
    case 'm':
      return check(ParseBordersParameters);
    case 'n':
      return check(ParseExportParameters);
    case 'o':
      return check(ParseInspectParameters);
    default:
      return false;
  }
}

}  // namespace tessera

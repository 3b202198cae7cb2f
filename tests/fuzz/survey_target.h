// survey.json, and the views and classes that tile packages hold.
#pragma once

#include <string>

#include "common/job/survey.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken as one of them.
inline bool RunSurveyTarget(const std::string& bytes) {
  const auto check = [](const auto& parsed, const auto& write, const auto& parse) {
    if (!parsed.ok()) {
      RequireRefusal(parsed.status());
      return false;
    }
    const std::string text = write(*parsed);
    const auto again = parse(text);
    Require(again.ok() && write(*again) == text, "what is written is read as it was");
    return true;
  };
  const bool survey = check(ParseSurvey(bytes), SurveyToJson, ParseSurvey);
  const bool views = check(ParseViews(bytes), ViewsToJson, ParseViews);
  const bool classes = check(ParseClasses(bytes), ClassesToJson, ParseClasses);
  return survey || views || classes;
}

}  // namespace tessera

#include "common/s3/aws_profile.h"

#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace tessera {

StatusOr<AwsProfile> ParseAwsProfile(const std::string& file, const std::string& text, const std::string& name) {
  AwsProfile profile;
  bool in_section = false, inside = false;
  int number = 0;
  for (const absl::string_view raw : absl::StrSplit(text, '\n')) {
    ++number;
    const absl::string_view line = absl::StripAsciiWhitespace(raw);
    if (line.empty() || line[0] == '#' || line[0] == ';') continue;
    if (line[0] == '[') {
      const size_t end = line.find(']');
      if (end == absl::string_view::npos) {
        return InputError(file, absl::StrCat("line ", number), "a section without an end", "[NAME] or [profile NAME]");
      }
      absl::string_view section = absl::StripAsciiWhitespace(line.substr(1, end - 1));
      if (section.substr(0, 8) == "profile ") section = absl::StripLeadingAsciiWhitespace(section.substr(8));
      in_section = true;
      inside = section == absl::string_view(name);
      continue;
    }
    const size_t equals = line.find('=');
    const bool nested = absl::ascii_isspace(static_cast<unsigned char>(raw[0]));
    if (nested) continue;
    if (equals == absl::string_view::npos || equals == 0 || !in_section) {
      return InputError(file, absl::StrCat("line ", number), "no setting of a profile", "[NAME], then NAME = VALUE");
    }
    if (inside) {
      profile[absl::AsciiStrToLower(absl::StripAsciiWhitespace(line.substr(0, equals)))] =
          std::string(absl::StripAsciiWhitespace(line.substr(equals + 1)));
    }
  }
  return profile;
}

}  // namespace tessera

// The files in which AWS's tools keep profiles.
#pragma once

#include <map>
#include <string>

#include "common/base/status.h"

namespace tessera {

// Settings of a profile by name.
using AwsProfile = std::map<std::string, std::string>;

// Reads the sections [NAME] and [profile NAME] of `text`, in which a later setting replaces an earlier one; empty if
// there are none. Lines of nested settings (indented) are skipped. INVALID_ARGUMENT names `file` and the line, never
// its content.
StatusOr<AwsProfile> ParseAwsProfile(const std::string& file, const std::string& text, const std::string& name);

}  // namespace tessera

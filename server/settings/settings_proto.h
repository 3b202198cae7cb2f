// Converts job settings to and from the message of tessera.v1 that requests and stored records share.
#pragma once

#include <string>
#include <vector>

#include "server/settings/job_settings.h"

namespace tessera {

namespace v1 {
class ExportSettings;
class JobSettings;
}  // namespace v1

// Does not validate; an empty method becomes "tessera".
JobSettings FromProto(const v1::JobSettings& proto);
void ToProto(const JobSettings& settings, v1::JobSettings* proto);
ExportSettings FromProto(const v1::ExportSettings& proto);
void ToProto(const ExportSettings& settings, v1::ExportSettings* proto);

// One line per setting that differs: "method_settings.levels: found 2, 1, 0, expected not set". Empty if none differs.
std::vector<std::string> Differences(const JobSettings& found, const JobSettings& expected);

}  // namespace tessera

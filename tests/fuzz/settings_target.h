// Job settings as messages: two frames, for an update and its base job.
#pragma once

#include <string>
#include <vector>

#include "common/job/method_settings.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if the first may be asked for.
inline bool RunSettingsTarget(const std::string& bytes) {
  std::vector<InputFrame> frames = SplitFrames(bytes);
  frames.resize(2);
  std::vector<JobSettings> both;
  for (const InputFrame& frame : frames) {
    v1::JobSettings proto;
    if (!proto.ParseFromString(frame.bytes)) return false;
    both.push_back(FromProto(proto));
  }
  const JobSettings& asked = both[0];
  const Status status = CheckJobSettings(asked);
  if (!status.ok()) Require(status.code() == absl::StatusCode::kInvalidArgument, "wrong input has its own code");
  const StatusOr<JobSettings> update = SettingsOfUpdate(asked, both[1]);
  if (!update.ok()) Require(update.status().code() == absl::StatusCode::kInvalidArgument, "the same of updates");
  Differences(asked, both[1]);
  if (!status.ok()) return false;
  v1::JobSettings written;
  ToProto(asked, &written);
  const JobSettings again = FromProto(written);
  Require(Differences(again, asked).empty() && CheckJobSettings(again).ok(), "what is written is read as it was");
  const StatusOr<MethodSettings> method = ParseMethodSettings(ToJson(asked.method_settings));
  Require(method.ok() && *method == asked.method_settings, "and as JSON");
  return true;
}

}  // namespace tessera

// The command line that repeats a job.
#pragma once

#include <string>
#include <string_view>

namespace tessera {

namespace v1 {
class Job;
}  // namespace v1

// `text` as one word of a shell's command.
std::string ShellWord(std::string_view text);

// "tessera run SCENE --method=... --out OUT", with the settings that are not the default. For an update, --base names
// the base job. Empty for a rollback and for a plan.
std::string RunCommandOf(const v1::Job& job);

}  // namespace tessera

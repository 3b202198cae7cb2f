#include "tests/e2e/coordinator_pair.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "tests/e2e/free_address.h"

namespace tessera::e2e {

CoordinatorPair::CoordinatorPair(const std::string& folder, const std::string& state,
                                 std::vector<std::string> arguments)
    : folder_(folder), state_(state), arguments_(std::move(arguments)), addresses_({FreeAddress(), FreeAddress()}) {}

Program& CoordinatorPair::Start(int which, const std::string& state, const std::vector<std::string>& arguments) {
  std::filesystem::remove(PortFile(which));
  std::vector<std::string> all = arguments_;
  all.insert(all.end(), arguments.begin(), arguments.end());
  const bool own_blobs = std::find(all.begin(), all.end(), "--blobs") != all.end();
  if (!own_blobs) all.insert(all.end(), {"--blobs", blobs()});
  all.insert(all.end(),
             {"--state", state.empty() ? state_ : state, "--data", folder_ + "/data-" + std::to_string(which),
              "--listen", addresses_[which], "--port-file", PortFile(which), "--lease-s", "3"});
  programs_[which] = nullptr;
  programs_[which] = std::make_unique<Program>(folder_, TESSERAD_PROGRAM, all);
  return *programs_[which];
}

bool CoordinatorPair::IsActive(int which) const { return std::filesystem::exists(PortFile(which)); }

bool CoordinatorPair::AwaitActive(int which) {
  WaitUntil([&] { return IsActive(which) || !programs_[which]->Running(); });
  return programs_[which]->Running();
}

bool CoordinatorPair::AwaitStandby(int which) {
  WaitUntil([&] {
    return programs_[which]->Output().find("coordinator stands by") != std::string::npos ||
           !programs_[which]->Running();
  });
  return programs_[which]->Running();
}

}  // namespace tessera::e2e

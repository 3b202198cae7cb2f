// Two coordinators with one state in PostgreSQL: one serves, the other stands by.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "tests/e2e/programs.h"

namespace tessera::e2e {

class CoordinatorPair {
 public:
  // `state`: postgresql://... `arguments`: further arguments of both.
  CoordinatorPair(const std::string& folder, const std::string& state, std::vector<std::string> arguments = {});

  // Starts coordinator 0 or 1, with `state` in place of the pair's if it is not empty. Does not wait.
  Program& Start(int which, const std::string& state = "", const std::vector<std::string>& arguments = {});
  Program& program(int which) { return *programs_[which]; }
  // Waits until the coordinator listens; false if it has ended instead.
  bool AwaitActive(int which);
  // Waits until the coordinator says that it stands by; false if it has ended instead.
  bool AwaitStandby(int which);
  bool IsActive(int which) const;

  const std::string& address(int which) const { return addresses_[which]; }
  // Of both, as clients and workers take it.
  std::string addresses() const { return addresses_[0] + "," + addresses_[1]; }
  const std::string& state() const { return state_; }
  std::string blobs() const { return folder_ + "/blobs"; }

 private:
  std::string PortFile(int which) const { return folder_ + "/address-" + std::to_string(which); }

  const std::string folder_, state_;
  const std::vector<std::string> arguments_;
  std::array<std::string, 2> addresses_;
  std::array<std::unique_ptr<Program>, 2> programs_;
};

}  // namespace tessera::e2e

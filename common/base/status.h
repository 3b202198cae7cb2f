// Errors: absl::Status, with one wording for wrong input.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace tessera {

using absl::Status;
using absl::StatusOr;

// INVALID_ARGUMENT for wrong input, with the message "FILE: LOCATION: found FOUND, expected EXPECTED". `location` is
// the position in the file ("line 12", "byte 4096", "faces[7]"); it may be empty.
Status InputError(const std::string& file, const std::string& location, const std::string& found,
                  const std::string& expected);

// The parts of such an error.
struct InputFault {
  std::string file, location, found, expected;
};

// The faults of an error made by InputError or Faults, in order; at most the first 50.
std::vector<InputFault> FaultsOf(const Status& status);
// Replaces the faults of `error`; its message stays.
void SetFaults(Status& error, const std::vector<InputFault>& faults);

// Collects all faults of an input, to report them together. Not thread-safe.
class Faults {
 public:
  // Records `status` unless it is OK.
  void Add(const Status& status);
  bool empty() const { return messages_.empty(); }
  const std::vector<std::string>& messages() const { return messages_; }
  // OK if there was no fault, else INVALID_ARGUMENT with one line per fault, shortened (ShortenLines).
  Status ToStatus() const;

 private:
  std::vector<std::string> messages_;
  std::vector<std::string> parts_;  // of the first 50 faults made by InputError
};

// Messages about unusual but not fatal input; report.json lists them all.
using Warnings = std::vector<std::string>;

}  // namespace tessera

#define TESSERA_CONCAT_INNER_(a, b) a##b
#define TESSERA_CONCAT_(a, b) TESSERA_CONCAT_INNER_(a, b)

// Returns from the function if `expr`, a Status, is an error.
#define TESSERA_RETURN_IF_ERROR(expr)                  \
  do {                                                 \
    ::absl::Status tessera_status_ = (expr);           \
    if (!tessera_status_.ok()) return tessera_status_; \
  } while (false)

// `lhs = value of expr`, a StatusOr, or returns its error.
#define TESSERA_ASSIGN_OR_RETURN(lhs, expr) \
  TESSERA_ASSIGN_OR_RETURN_IMPL_(TESSERA_CONCAT_(tessera_or_, __LINE__), lhs, expr)
#define TESSERA_ASSIGN_OR_RETURN_IMPL_(or_name, lhs, expr) \
  auto or_name = (expr);                                   \
  if (!or_name.ok()) return or_name.status();              \
  lhs = *std::move(or_name)

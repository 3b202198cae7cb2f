// Errors: absl::Status everywhere, with the house's own wording for bad input.
#ifndef TESSERA_COMMON_BASE_STATUS_H_
#define TESSERA_COMMON_BASE_STATUS_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace tessera {

using absl::Status;
using absl::StatusOr;

// Where input is wrong: file, place in it ("line 12", "byte 4096", "faces[7]"; may be empty), what was found there
// and what was expected. Gives INVALID_ARGUMENT reading "FILE: PLACE: found FOUND, expected EXPECTED".
Status InputError(const std::string& file, const std::string& place, const std::string& found,
                  const std::string& expected);

// What such an error tells, in parts.
struct InputFault {
  std::string file, place, found, expected;
};

// Those that the error tells of, in their order, the first 50: of InputError, and of Faults that had such errors.
std::vector<InputFault> FaultsOf(const Status& status);
// In place of those that it has; of an error with a message of its own.
void SetFaults(Status& error, const std::vector<InputFault>& faults);

// Collects every fault of an input so that all are reported at once. Not thread-safe.
class Faults {
 public:
  // Records `status` unless it is OK.
  void Add(const Status& status);
  bool empty() const { return messages_.empty(); }
  const std::vector<std::string>& messages() const { return messages_; }
  // OK if there was no fault, else INVALID_ARGUMENT with one line a fault.
  Status ToStatus() const;

 private:
  std::vector<std::string> messages_;
  std::vector<std::string> parts_;  // of the first that InputError made
};

// What is odd but not fatal; the user sees all of it in the job's report.
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

#endif  // TESSERA_COMMON_BASE_STATUS_H_

// Moving a state between databases.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

class StateStore;

// A table that every state has. Its first column is the primary key.
struct StateTable {
  enum class Type { kNumber, kText, kBlob };
  struct Column {
    const char* name;
    Type type;
  };
  const char* name;
  std::vector<Column> columns;
};

const std::vector<StateTable>& StateTables();
// The names of the columns, separated by commas.
std::string ColumnsOf(const StateTable& table);

// A row as it is stored, damaged or not: a value a column, numbers in decimal.
using StateRow = std::vector<std::string>;
using RowSink = std::function<Status(const StateTable& table, const StateRow& row)>;

// Copies all that the state `from` has into the empty state `to`, or nothing: records with their numbers, removed and
// quarantined ones, deleted jobs, digests, kept values with the worker key. Start counts of the two never coincide.
// FAILED_PRECONDITION if `to` has records. Afterwards the right to write `to` is released. Returns the number of
// records.
StatusOr<int64_t> CopyState(StateStore& from, StateStore& to);

}  // namespace tessera

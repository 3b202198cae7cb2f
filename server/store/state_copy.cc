#include "server/store/state_copy.h"

#include <random>

#include "absl/strings/str_join.h"
#include "server/store/state_store.h"

namespace tessera {

const std::vector<StateTable>& StateTables() {
  constexpr auto kNumber = StateTable::Type::kNumber, kText = StateTable::Type::kText, kBlob = StateTable::Type::kBlob;
  static const auto* const tables = new std::vector<StateTable>{
      {"records", {{"id", kNumber}, {"content", kBlob}, {"xxh3", kNumber}, {"job", kNumber}}},
      {"set_aside", {{"id", kNumber}, {"reason", kText}}},
      {"deleted_jobs", {{"job", kNumber}}},
      {"removed", {{"first", kNumber}, {"last", kNumber}}},
      {"kept", {{"name", kText}, {"value", kBlob}}},
      {"file_digests", {{"path", kText}, {"size_bytes", kNumber}, {"modified_ns", kNumber}, {"sha256", kText}}},
  };
  return *tables;
}

std::string ColumnsOf(const StateTable& table) {
  return absl::StrJoin(table.columns, ", ",
                       [](std::string* out, const StateTable::Column& column) { out->append(column.name); });
}

StatusOr<int64_t> CopyState(StateStore& from, StateStore& to) {
  // Moves a key that earlier releases kept in a file.
  TESSERA_RETURN_IF_ERROR(from.WorkerKey().status());
  // As BackUp: worker names contain the start count, and workers of `from` may still be alive.
  std::random_device random;
  const int64_t starts = from.StartCount() + (int64_t{1} << 20) +
                         ((int64_t{random()} << 32 | int64_t{random()}) & ((int64_t{1} << 40) - 1));
  int64_t records = 0;
  TESSERA_RETURN_IF_ERROR(to.Import(
      [&](const RowSink& add) {
        return from.Export([&](const StateTable& table, const StateRow& row) {
          records += &table == &StateTables().front() ? 1 : 0;
          return add(table, row);
        });
      },
      starts));
  return records;
}

}  // namespace tessera

// A tile's state as a value, from its file and as a view.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "worker/tile/tile_files.h"

namespace tessera {

// Errors as MappedState::Open's.
inline StatusOr<TileState> ReadTileState(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const MappedState mapped, MappedState::Open(path));
  const StateSpans& from = mapped.spans();
  TileState state;
  const auto copy = []<class T>(std::span<const T> values, std::vector<T>* out) {
    out->assign(values.begin(), values.end());
  };
  state.tile = from.tile;
  copy(from.vertex_ids, &state.vertex_ids);
  copy(from.positions, &state.positions);
  copy(from.level_start, &state.level_start);
  copy(from.last_step, &state.last_step);
  copy(from.face_ids, &state.face_ids);
  copy(from.labels, &state.labels);
  copy(from.confidence, &state.confidence);
  state.report = from.report;
  return state;
}

// `s` must outlive the result.
inline StateSpans SpansOf(const TileState& s) {
  return {s.tile, s.vertex_ids, s.face_ids, s.positions, s.level_start, s.last_step, s.labels, s.confidence, s.report};
}

}  // namespace tessera

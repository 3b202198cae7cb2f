// Compares the results of two jobs byte for byte, and describes the first difference.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "common/meshio/ply.h"
#include "tests/support/tiny_scene.h"

namespace tessera {

// Compares two PLY files.
inline testing::AssertionResult SameMesh(const std::string& expected_path, const std::string& found_path) {
  if (ReadText(expected_path) == ReadText(found_path)) return testing::AssertionSuccess();
  const auto expected = ReadPly(expected_path), found = ReadPly(found_path);
  if (!expected.ok() || !found.ok()) return testing::AssertionFailure() << expected.status() << found.status();
  const TriangleMesh &a = expected->mesh, &b = found->mesh;
  if (a.faces != b.faces || a.vertices.size() != b.vertices.size() || a.labels.size() != b.labels.size()) {
    return testing::AssertionFailure() << "faces or element counts differ";
  }
  size_t vertices = 0, labels = 0, first = a.vertices.size();
  double farthest_m = 0;
  for (size_t v = 0; v < a.vertices.size(); ++v) {
    if (a.vertices[v] == b.vertices[v]) continue;
    first = std::min(first, v);
    ++vertices;
    farthest_m = std::max(farthest_m, (a.vertices[v] - b.vertices[v]).norm());
  }
  for (size_t f = 0; f < a.labels.size(); ++f) labels += a.labels[f] != b.labels[f];
  return testing::AssertionFailure() << vertices << " of " << a.vertices.size() << " vertices differ, the first is "
                                     << first << ", by " << farthest_m << " m at most, and " << labels << " of "
                                     << a.labels.size() << " labels; else the confidences do";
}

}  // namespace tessera

// Meshes of tiles.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/exporting/sheet.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Positions are multiples of this. A power of two: a float that is relative to a multiple of it is exact within 4,096
// m, so that a vertex has the same position in all tiles that use it.
inline constexpr double kTiles3dGrid_m = 0x1p-12;

// Vertices that several tiles share.
struct Tiles3dVertices {
  std::vector<Eigen::Vector3d> positions;  // east-north-up, metres, multiples of kTiles3dGrid_m
  std::vector<Eigen::Vector3f> normals;    // unit vectors, of the finest mesh
  std::vector<float> confidence;           // in [0, 1]; empty: not known
  std::vector<float> displacement_m;       // empty: not known
  std::vector<Rgb> colors;                 // sRGB; empty: a vertex has the colour of its class
  std::vector<uint8_t> shared;             // 1: other tiles may have the vertex too
};

// Triangles over shared vertices.
struct Tiles3dFaces {
  std::vector<Triangle> corners;
  std::vector<int32_t> labels;  // one a face; -1: none

  void Add(const Triangle& face, int32_t label) {
    corners.push_back(face);
    labels.push_back(label);
  }
  void Append(const Tiles3dFaces& other);
  size_t size() const { return corners.size(); }
};

// A point of the finest mesh, by which a coarser one measures its distance.
struct Tiles3dPoint {
  Eigen::Vector3d position;
  uint32_t face = 0;  // index of a face that it is near to
};

// Faces with the vertices that they use.
struct Tiles3dMesh {
  Tiles3dVertices vertices;
  Tiles3dFaces faces;
  std::vector<uint32_t> vertex_of;  // per vertex: its index where it was taken from
};
Tiles3dMesh CompactTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces);

// The same triangles over corners that are each of one class: a vertex where classes meet becomes one wedge a class.
struct Tiles3dWedges {
  std::vector<uint32_t> vertices;  // per wedge: its vertex
  std::vector<int32_t> labels;     // per wedge
  std::vector<Triangle> faces;     // indices of wedges
};
Tiles3dWedges MakeTiles3dWedges(const Tiles3dFaces& faces, size_t vertex_count);

// Per vertex of the mesh: 1 if its faces do not surround it.
std::vector<uint8_t> Tiles3dBorder(const Tiles3dFaces& faces, size_t vertex_count);

}  // namespace tessera

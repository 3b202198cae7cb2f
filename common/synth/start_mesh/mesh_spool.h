// A labelled mesh that is built in two temporary files, so that it may exceed memory.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Vertices and labelled faces in two plain files, in the order in which they are added. The destructor removes the
// files. Not thread-safe. Rewind returns the errors of writing.
class MeshSpool {
 public:
  explicit MeshSpool(const std::string& path_prefix);
  ~MeshSpool();
  MeshSpool(const MeshSpool&) = delete;
  MeshSpool& operator=(const MeshSpool&) = delete;

  void AddVertex(const Eigen::Vector3d& p);
  void AddFace(const Triangle& face, int32_t label);
  int64_t vertex_count() const { return vertex_count_; }
  int64_t face_count() const { return face_count_; }

  // Ends writing and starts reading from the first record. May be called again to read again.
  Status Rewind();
  // False at the end. Call Rewind first.
  bool NextVertex(Eigen::Vector3d* p);
  bool NextFace(Triangle* face, int32_t* label);

 private:
  std::string vertex_path_, face_path_;
  std::FILE* vertices_ = nullptr;
  std::FILE* faces_ = nullptr;
  int64_t vertex_count_ = 0, face_count_ = 0;
  bool failed_ = false;
};

// Writes the spool as PLY, as PlyStream does.
Status WriteSpooledPly(const std::string& path, MeshSpool& spool);

// Copies `from` to `to` without the connected components of fewer than `min_faces` faces and without the vertices of no
// face. Memory: 8 bytes a vertex.
Status DropSmallComponents(MeshSpool& from, int64_t min_faces, MeshSpool& to);

}  // namespace tessera

// Where the files of an export are made, before they get their final names.
#pragma once

#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/storage/files.h"

namespace tessera {

// The folder OUT/.export. Another export of the same folder waits for nothing: it is refused. The destructor removes
// the folder, and OUT if it is empty and was made here; if the process is killed, the next export replaces it. Movable.
class ExportStaging {
 public:
  // ALREADY_EXISTS if `out` has files that are not of an interrupted export; FAILED_PRECONDITION if another process
  // exports to it.
  static StatusOr<ExportStaging> Open(const std::string& out);
  ExportStaging(ExportStaging&& other) noexcept;
  ExportStaging& operator=(ExportStaging&&) = delete;
  ~ExportStaging();

  // A folder in it, made if it is missing.
  StatusOr<std::string> Folder(const std::string& name) const;
  // Moves the content of a folder in it to OUT, `last` at the end. A file appears whole or not at all.
  Status Publish(const std::string& folder, const std::string& last) const;

 private:
  explicit ExportStaging(std::string out) : out_(std::move(out)) {}
  std::string out_, path_;
  bool made_out_ = false;
  std::optional<FileLock> lock_;
};

}  // namespace tessera

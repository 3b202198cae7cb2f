// Published files of jobs over HTTP: by name, also those inside the archives of sheets, whole or in part.
#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "common/base/status.h"
#include "common/storage/hash.h"
#include "server/grpc/local_calls.h"
#include "server/http/stored_zip.h"
#include "server/web/web_message.h"

namespace tessera {

// Where a published file is: a blob or a range of one.
struct FilePlace {
  Digest blob;
  int64_t offset_bytes = 0, size_bytes = 0;
  std::string etag;
};

// Reads through the blob service, in parts, with the rights of the caller. Thread-safe.
class JobFiles {
 public:
  static constexpr size_t kMaxDirectories = 64;       // of archives, in memory
  static constexpr size_t kMaxMembersKept = 500'000;  // of all directories

  // `calls` must outlive this and the answers.
  explicit JobFiles(LocalCalls* calls) : calls_(*calls) {}

  // The file `name` of `job`, as `tessera fetch` writes it: NOT_FOUND if there is none.
  StatusOr<FilePlace> Find(const LocalCaller& caller, const std::string& job, const std::string& name);

  // 200, 206, 304 or 416, or an error.
  WebAnswer Answer(const WebRequest& request, const LocalCaller& caller, const std::string& job,
                   const std::string& name);

 private:
  using Directory = std::shared_ptr<const ZipDirectory>;
  StatusOr<Digest> FindArtifact(const LocalCaller& caller, const std::string& job, const std::string& name);
  StatusOr<FilePlace> FindInArchives(const LocalCaller& caller, const std::string& job, const std::string& name);
  StatusOr<Directory> DirectoryOf(const LocalCaller& caller, const Digest& archive);
  StatusOr<std::string> Read(const LocalCaller& caller, const Digest& blob, int64_t offset_bytes, int64_t size_bytes);

  LocalCalls& calls_;
  std::mutex mutex_;
  std::list<std::pair<std::string, Directory>> directories_;  // by SHA-256; used last is first
  size_t members_ = 0;
};

// Of a file's name: "model/gltf-binary" for .glb.
std::string_view ContentTypeOf(std::string_view name);

// The part of `size_bytes` that a Range header asks for: [first, last]. The whole file if the header is malformed or
// asks for several parts; OUT_OF_RANGE if no byte is in it.
StatusOr<std::pair<int64_t, int64_t>> RangeOf(std::string_view header, int64_t size_bytes);

// Whether a list of ETags, as of If-None-Match, has this one (without quotes).
bool HasEtag(std::string_view header, std::string_view etag);

}  // namespace tessera

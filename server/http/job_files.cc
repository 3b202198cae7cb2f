#include "server/http/job_files.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/exporting/export_parameters.h"
#include "tessera/v1/blobs.pb.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr char kListArtifacts[] = "/tessera.v1.Jobs/ListArtifacts", kReadBlob[] = "/tessera.v1.Blobs/ReadBlob";
constexpr double kFileCall_s = 30;
constexpr double kChunk_s = 25;   // longest wait for a part of a blob; a lost one is recomputed in 20 s
constexpr int kMaxArchives = 64;  // that are searched for a file whose name does not name its sheet
constexpr char kSandbox[] = "sandbox; default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'";

v1::ReadBlobRequest ReadRequest(const Digest& blob, int64_t offset_bytes) {
  v1::ReadBlobRequest request;
  request.mutable_digest()->set_sha256(blob.sha256);
  request.mutable_digest()->set_size_bytes(blob.size_bytes);
  request.set_offset(offset_bytes);
  return request;
}

// Reads the next part of a blob.
Status ReadPart(LocalCalls::Stream& stream, std::string* bytes) {
  std::string message;
  const auto event = stream.Read(kChunk_s, &message);
  if (event == LocalCalls::Stream::Event::kTimeout) return absl::UnavailableError("the blob cannot be read now");
  if (event == LocalCalls::Stream::Event::kEnd) {
    return stream.status().ok() ? absl::DataLossError("the blob is too short") : stream.status();
  }
  v1::BlobChunk chunk;
  if (!chunk.ParseFromString(message)) return absl::InternalError("malformed part of a blob");
  *bytes = std::move(*chunk.mutable_data());
  return absl::OkStatus();
}

// Writes `part` and those that follow it, `size_bytes` together. False: broken off.
bool WriteParts(LocalCalls::Stream& stream, std::string part, int64_t size_bytes, const AnswerSink& sink) {
  while (true) {
    const std::string_view bytes =
        std::string_view(part).substr(0, static_cast<size_t>(std::min<int64_t>(size_bytes, part.size())));
    if (!sink.write(bytes)) return false;
    size_bytes -= static_cast<int64_t>(bytes.size());
    if (size_bytes == 0) return true;
    if (!ReadPart(stream, &part).ok()) return false;
  }
}

// Names of archives that may hold the file, the likely one first: "export/3dtiles/3_-1.zip" for
// "export/3dtiles/result/3_-1/0.glb". `folder`: gets "export/3dtiles/".
std::vector<std::string> LikelyArchives(const std::string& name, std::string* folder) {
  const std::vector<std::string> parts = absl::StrSplit(name, '/');
  std::vector<std::string> archives;
  if (parts.size() < 3 || absl::StrCat(parts[0], "/", parts[1], "/") != ExportFolderOf(parts[1])) return archives;
  *folder = ExportFolderOf(parts[1]);
  for (size_t i = 2; i < parts.size(); ++i) {
    const std::string& part = parts[i];
    if (part.find_first_not_of("0123456789_-") != std::string::npos || part.find('_') == std::string::npos) continue;
    archives.push_back(absl::StrCat(*folder, part, kSheetArchiveEnding));
  }
  return archives;
}

struct ContentType {
  std::string_view ending, type;
};

constexpr ContentType kTypes[] = {
    {".html", "text/html; charset=utf-8"},
    {".json", "application/json"},
    {".geojson", "application/geo+json"},
    {".glb", "model/gltf-binary"},
    {".png", "image/png"},
    {".jpg", "image/jpeg"},
    {".svg", "image/svg+xml"},
    {".tif", "image/tiff"},
    {".txt", "text/plain; charset=utf-8"},
    {".log", "text/plain; charset=utf-8"},
    {".csv", "text/csv; charset=utf-8"},
    {".mtl", "text/plain; charset=utf-8"},
    {".obj", "model/obj"},
    {".zip", "application/zip"},
};

bool ParseNumber(std::string_view text, int64_t* number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *number);
  return !text.empty() && text.front() != '-' && error == std::errc() && end == text.data() + text.size();
}

}  // namespace

std::string_view ContentTypeOf(std::string_view name) {
  for (const ContentType& known : kTypes) {
    if (name.ends_with(known.ending)) return known.type;
  }
  return "application/octet-stream";
}

StatusOr<std::pair<int64_t, int64_t>> RangeOf(std::string_view header, int64_t size_bytes) {
  const std::pair<int64_t, int64_t> whole = {0, size_bytes - 1};
  if (!header.starts_with("bytes=") || header.find(',') != std::string_view::npos) return whole;
  header.remove_prefix(6);
  const size_t dash = header.find('-');
  if (dash == std::string_view::npos) return whole;
  const std::string_view from = header.substr(0, dash), to = header.substr(dash + 1);
  int64_t first = 0, last = size_bytes - 1;
  if (from.empty()) {
    int64_t count = 0;
    if (!ParseNumber(to, &count)) return whole;
    if (count == 0 || size_bytes == 0) return absl::OutOfRangeError("no byte is in the range");
    return std::pair{std::max<int64_t>(0, size_bytes - count), size_bytes - 1};
  }
  if (!ParseNumber(from, &first) || (!to.empty() && !ParseNumber(to, &last)) || last < first) {
    if (to.empty() && first > last && first >= size_bytes) return absl::OutOfRangeError("no byte is in the range");
    return whole;
  }
  if (first >= size_bytes) return absl::OutOfRangeError("no byte is in the range");
  return std::pair{first, std::min(last, size_bytes - 1)};
}

bool HasEtag(std::string_view header, std::string_view etag) {
  for (absl::string_view part : absl::StrSplit(absl::string_view(header.data(), header.size()), ',')) {
    std::string_view one(part.data(), part.size());
    while (one.starts_with(' ')) one.remove_prefix(1);
    while (one.ends_with(' ')) one.remove_suffix(1);
    if (one == "*") return true;
    if (one.starts_with("W/")) one.remove_prefix(2);
    if (one.size() == etag.size() + 2 && one.starts_with('"') && one.ends_with('"') &&
        one.substr(1, etag.size()) == etag) {
      return true;
    }
  }
  return false;
}

StatusOr<std::string> JobFiles::Read(const LocalCaller& caller, const Digest& blob, int64_t offset_bytes,
                                     int64_t size_bytes) {
  TESSERA_ASSIGN_OR_RETURN(const auto stream,
                           calls_.Open(kReadBlob, caller, ReadRequest(blob, offset_bytes).SerializeAsString()));
  std::string bytes, part;
  while (static_cast<int64_t>(bytes.size()) < size_bytes) {
    TESSERA_RETURN_IF_ERROR(ReadPart(*stream, &part));
    bytes += part;
  }
  bytes.resize(static_cast<size_t>(size_bytes));
  return bytes;
}

StatusOr<Digest> JobFiles::FindArtifact(const LocalCaller& caller, const std::string& job, const std::string& name) {
  v1::ListArtifactsRequest request;
  request.set_parent(job);
  request.set_name_prefix(name);
  v1::ListArtifactsResponse page;
  do {
    request.set_page_token(page.next_page_token());
    TESSERA_ASSIGN_OR_RETURN(const std::string answer,
                             calls_.Call(kListArtifacts, caller, request.SerializeAsString(), kFileCall_s));
    if (!page.ParseFromString(answer)) return absl::InternalError("malformed answer");
    for (const v1::Artifact& artifact : page.artifacts()) {
      if (artifact.name() == name) return Digest{artifact.digest().sha256(), artifact.digest().size_bytes()};
    }
  } while (!page.next_page_token().empty());
  return absl::NotFoundError(absl::StrCat(job, " has no file of this name"));
}

StatusOr<JobFiles::Directory> JobFiles::DirectoryOf(const LocalCaller& caller, const Digest& archive) {
  {
    std::lock_guard lock(mutex_);
    for (auto known = directories_.begin(); known != directories_.end(); ++known) {
      if (known->first != archive.sha256) continue;
      directories_.splice(directories_.begin(), directories_, known);
      return known->second;
    }
  }
  TESSERA_ASSIGN_OR_RETURN(ZipDirectory read,
                           ReadZipDirectory(archive.size_bytes, [&](int64_t offset_bytes, int64_t size_bytes) {
                             return Read(caller, archive, offset_bytes, size_bytes);
                           }));
  const auto directory = std::make_shared<const ZipDirectory>(std::move(read));
  std::lock_guard lock(mutex_);
  directories_.emplace_front(archive.sha256, directory);
  members_ += directory->size();
  while (directories_.size() > 1 && (directories_.size() > kMaxDirectories || members_ > kMaxMembersKept)) {
    members_ -= directories_.back().second->size();
    directories_.pop_back();
  }
  return directory;
}

StatusOr<FilePlace> JobFiles::FindInArchives(const LocalCaller& caller, const std::string& job,
                                             const std::string& name) {
  const Status missing = absl::NotFoundError(absl::StrCat(job, " has no file of this name"));
  std::string folder;
  const std::vector<std::string> likely = LikelyArchives(name, &folder);
  if (folder.empty()) return missing;
  const std::string member = name.substr(folder.size());
  const auto find_in = [&](const Digest& archive) -> StatusOr<std::optional<FilePlace>> {
    TESSERA_ASSIGN_OR_RETURN(const Directory directory, DirectoryOf(caller, archive));
    const auto found = directory->find(member);
    if (found == directory->end()) return std::optional<FilePlace>();
    return std::optional(FilePlace{archive, found->second.offset_bytes, found->second.size_bytes,
                                   absl::StrCat(archive.sha256, "-", found->second.offset_bytes)});
  };
  for (const std::string& archive : likely) {
    const auto digest = FindArtifact(caller, job, archive);
    if (absl::IsNotFound(digest.status())) continue;
    TESSERA_RETURN_IF_ERROR(digest.status());
    TESSERA_ASSIGN_OR_RETURN(const auto place, find_in(*digest));
    if (place) return *place;
  }
  if (!likely.empty()) return missing;
  v1::ListArtifactsRequest request;
  request.set_parent(job);
  request.set_name_prefix(folder);
  TESSERA_ASSIGN_OR_RETURN(const std::string answer,
                           calls_.Call(kListArtifacts, caller, request.SerializeAsString(), kFileCall_s));
  v1::ListArtifactsResponse page;
  if (!page.ParseFromString(answer)) return absl::InternalError("malformed answer");
  int searched = 0;
  for (const v1::Artifact& artifact : page.artifacts()) {
    if (!std::string_view(artifact.name()).ends_with(kSheetArchiveEnding)) continue;
    if (++searched > kMaxArchives) break;
    TESSERA_ASSIGN_OR_RETURN(const auto place, find_in({artifact.digest().sha256(), artifact.digest().size_bytes()}));
    if (place) return *place;
  }
  return missing;
}

StatusOr<FilePlace> JobFiles::Find(const LocalCaller& caller, const std::string& job, const std::string& name) {
  const auto artifact = FindArtifact(caller, job, name);
  if (artifact.ok()) return FilePlace{*artifact, 0, artifact->size_bytes, artifact->sha256};
  if (!absl::IsNotFound(artifact.status())) return artifact.status();
  return FindInArchives(caller, job, name);
}

WebAnswer JobFiles::Answer(const WebRequest& request, const LocalCaller& caller, const std::string& job,
                           const std::string& name) {
  const auto place = Find(caller, job, name);
  if (!place.ok()) return ErrorAnswer(place.status());
  WebAnswer answer;
  answer.type = ContentTypeOf(name);
  answer.headers = {{"ETag", absl::StrCat("\"", place->etag, "\"")},
                    {"Accept-Ranges", "bytes"},
                    {"Cache-Control", "private, no-cache"}};
  if (answer.type.starts_with("text/html") || answer.type.starts_with("image/svg")) {
    answer.headers.emplace_back("Content-Security-Policy", kSandbox);
  }
  if (HasEtag(request.Header("If-None-Match").value_or(""), place->etag)) {
    answer.status = 304;
    return answer;
  }
  std::string asked = request.Header("Range").value_or("");
  if (const auto only_if = request.Header("If-Range"); only_if && !HasEtag(*only_if, place->etag)) asked.clear();
  const auto range = RangeOf(asked, place->size_bytes);
  if (!range.ok()) {
    answer = ErrorAnswer(416, "OUT_OF_RANGE", std::string(range.status().message()));
    answer.headers.emplace_back("Content-Range", absl::StrCat("bytes */", place->size_bytes));
    return answer;
  }
  const int64_t size_bytes = range->second - range->first + 1;
  if (size_bytes < place->size_bytes) {
    answer.status = 206;
    answer.headers.emplace_back("Content-Range",
                                absl::StrCat("bytes ", range->first, "-", range->second, "/", place->size_bytes));
  }
  answer.produced_bytes = size_bytes;
  if (request.method == "HEAD") {
    answer.produce = [](const AnswerSink&) { return true; };
    return answer;
  }
  // The first part is read before the answer begins, so that an error has its status.
  auto opened =
      calls_.Open(kReadBlob, caller, ReadRequest(place->blob, place->offset_bytes + range->first).SerializeAsString());
  if (!opened.ok()) return ErrorAnswer(opened.status());
  const std::shared_ptr<LocalCalls::Stream> stream = *std::move(opened);
  std::string first;
  if (size_bytes > 0) {
    if (const Status read = ReadPart(*stream, &first); !read.ok()) return ErrorAnswer(read);
  }
  answer.produce = [stream, first = std::move(first), size_bytes](const AnswerSink& sink) mutable {
    return WriteParts(*stream, std::move(first), size_bytes, sink);
  };
  return answer;
}

}  // namespace tessera

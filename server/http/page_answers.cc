#include "server/http/page_answers.h"

#include <zlib.h>

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/storage/hash.h"
#include "server/http/job_files.h"
#include "server/page/page_files.h"

namespace tessera {
namespace {

constexpr size_t kMaxFileBytes = size_t{64} << 20;

constexpr char kMissing[] =
    "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>Tessera</title>\n"
    "<h1>Tessera</h1>\n"
    "<p>This coordinator was built without its page. To add it, install Debian's packages nodejs and npm "
    "(deploy/install-packages does), configure and build again, and start tesserad again.</p>\n"
    "<p>The API is served: <a href=\"/api/v1/jobs\">/api/v1/jobs</a>.</p>\n</html>\n";

const PageFile* FindFile(std::string_view name) {
  const std::vector<PageFile>& files = PageFiles();
  const auto found = std::lower_bound(files.begin(), files.end(), name,
                                      [](const PageFile& file, std::string_view n) { return file.name < n; });
  return found == files.end() || found->name != name ? nullptr : &*found;
}

std::string_view TypeOfAsset(std::string_view name) {
  if (name.ends_with(".js")) return "text/javascript; charset=utf-8";
  if (name.ends_with(".css")) return "text/css; charset=utf-8";
  return ContentTypeOf(name);
}

// Empty if it is malformed.
std::string Gunzip(std::string_view packed) {
  z_stream stream = {};
  if (inflateInit2(&stream, 16 + MAX_WBITS) != Z_OK) return "";
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  std::string text;
  char part[16 << 10];
  int state = Z_OK;
  while (state == Z_OK && text.size() < kMaxFileBytes) {
    stream.next_out = reinterpret_cast<Bytef*>(part);
    stream.avail_out = sizeof(part);
    state = inflate(&stream, Z_NO_FLUSH);
    text.append(part, sizeof(part) - stream.avail_out);
  }
  inflateEnd(&stream);
  return state == Z_STREAM_END ? text : "";
}

}  // namespace

WebAnswer PageAnswer(const WebRequest& request, const std::string& asset) {
  WebAnswer answer;
  const bool is_page = asset.empty();
  const std::string name = is_page ? "index.html" : absl::StrCat("assets/", asset);
  const PageFile* const file = FindFile(name);
  if (file == nullptr && !(is_page && PageFiles().empty())) return ErrorAnswer(404, "NOT_FOUND", "no such path");
  answer.type = TypeOfAsset(name);
  // Names of assets change with their content.
  answer.headers.emplace_back("Cache-Control", is_page ? "no-cache" : "public, max-age=31536000, immutable");
  if (file == nullptr) {
    answer.body = kMissing;
    return answer;
  }
  const std::string etag = Xxh3Hex(file->gzip.data(), file->gzip.size());
  answer.headers.emplace_back("ETag", absl::StrCat("\"", etag, "\""));
  answer.headers.emplace_back("Vary", "Accept-Encoding");
  if (HasEtag(request.Header("If-None-Match").value_or(""), etag)) {
    answer.status = 304;
    answer.type.clear();
    return answer;
  }
  if (absl::StrContains(request.Header("Accept-Encoding").value_or(""), "gzip")) {
    answer.headers.emplace_back("Content-Encoding", "gzip");
    answer.body = file->gzip;
  } else {
    answer.body = Gunzip(file->gzip);
  }
  return answer;
}

}  // namespace tessera

#include "common/storage/zip_file.h"

#include <zip.h>

#include <algorithm>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr int64_t kMaxZipMembers = 100'000;
constexpr int64_t kMaxZipFileBytes = int64_t{4} << 30;
constexpr int64_t kMaxZipTotalBytes = int64_t{8} << 30;
constexpr int64_t kMaxDeflateRatio = 1032, kDeflateSlackBytes = 1024;  // a property of the method
constexpr size_t kZipChunkBytes = size_t{1} << 20;

bool LeadsOutside(std::string_view name) {
  if (name.empty() || name.front() == '/' || name.find('\\') != std::string_view::npos ||
      name.find(':') != std::string_view::npos) {
    return true;
  }
  for (size_t at = 0; at <= name.size();) {
    const size_t end = std::min(name.find('/', at), name.size());
    if (name.substr(at, end - at) == "..") return true;
    at = end + 1;
  }
  return false;
}

}  // namespace

struct ZipFile::Impl {
  ~Impl() {
    if (archive != nullptr) zip_discard(archive);
  }
  std::string name;
  std::string bytes;  // of the archive, which libzip reads in place
  zip_t* archive = nullptr;
  std::vector<std::string> members;
  std::unordered_map<std::string, zip_uint64_t> index;
  int64_t total_bytes = 0;  // of members read
};

bool IsZip(std::string_view head) { return head.starts_with("PK\3\4") || head.starts_with("PK\5\6"); }

ZipFile::ZipFile(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ZipFile::ZipFile(ZipFile&&) noexcept = default;
ZipFile& ZipFile::operator=(ZipFile&&) noexcept = default;
ZipFile::~ZipFile() = default;

const std::string& ZipFile::name() const { return impl_->name; }
const std::vector<std::string>& ZipFile::members() const { return impl_->members; }
bool ZipFile::Has(const std::string& member) const { return impl_->index.contains(member); }

StatusOr<ZipFile> ZipFile::Open(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(std::string bytes, ReadFile(path, kMaxZipFileBytes));
  return Parse(std::move(bytes), path);
}

StatusOr<ZipFile> ZipFile::Parse(std::string bytes, const std::string& name) {
  auto impl = std::make_unique<Impl>();
  impl->name = name;
  impl->bytes = std::move(bytes);
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* source = zip_source_buffer_create(impl->bytes.data(), impl->bytes.size(), 0, &error);
  if (source != nullptr) impl->archive = zip_open_from_source(source, ZIP_RDONLY, &error);
  const std::string reason = zip_error_strerror(&error);
  zip_error_fini(&error);
  if (impl->archive == nullptr) {
    if (source != nullptr) zip_source_free(source);
    return InputError(name, "", reason, "a zip archive; the file may be cut off");
  }
  const int64_t count = zip_get_num_entries(impl->archive, 0);
  if (count > kMaxZipMembers) {
    return InputError(name, "", absl::StrCat(count, " members"), absl::StrCat("at most ", kMaxZipMembers));
  }
  for (int64_t i = 0; i < count; ++i) {
    const char* text = zip_get_name(impl->archive, i, ZIP_FL_ENC_GUESS);
    const std::string member = text == nullptr ? "" : text;
    if (LeadsOutside(member)) {
      return InputError(name, absl::StrCat("member ", i),
                        absl::StrCat("the name '", Printable(Prefix(member, 60)), "'"), "a name inside the archive");
    }
    if (!impl->index.emplace(member, i).second) {
      return InputError(name, absl::StrCat("member ", i),
                        absl::StrCat("a second '", Printable(Prefix(member, 60)), "'"), "each name once");
    }
    if (member.back() != '/') impl->members.push_back(member);
  }
  return ZipFile(std::move(impl));
}

StatusOr<std::string> ZipFile::Read(const std::string& member, int64_t max_bytes) {
  const auto error = [&](const std::string& found, const std::string& expected) {
    return InputError(absl::StrCat(impl_->name, "/", Printable(member)), "", found, expected);
  };
  const auto found = impl_->index.find(member);
  if (found == impl_->index.end()) return error("no such member of the archive", "it");
  zip_stat_t stat;
  zip_stat_init(&stat);
  constexpr zip_uint64_t kNeeded = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
  if (zip_stat_index(impl_->archive, found->second, 0, &stat) != 0 || (stat.valid & kNeeded) != kNeeded) {
    return error("a damaged entry", "an entry with its size");
  }
  if (stat.comp_method != ZIP_CM_STORE && stat.comp_method != ZIP_CM_DEFLATE) {
    return error(absl::StrCat("compression method ", stat.comp_method), "deflate or none");
  }
  max_bytes = std::min(max_bytes, kMaxZipTotalBytes - impl_->total_bytes);
  if (stat.size > static_cast<uint64_t>(max_bytes)) {
    return error(absl::StrCat(stat.size, " bytes"), absl::StrCat("at most ", max_bytes));
  }
  if (stat.comp_size > impl_->bytes.size() || stat.size > kMaxDeflateRatio * stat.comp_size + kDeflateSlackBytes) {
    return error(absl::StrCat(stat.size, " bytes from ", stat.comp_size, " compressed ones"),
                 "sizes that are possible");
  }
  impl_->total_bytes += static_cast<int64_t>(stat.size);
  zip_file_t* file = zip_fopen_index(impl_->archive, found->second, 0);
  if (file == nullptr) return error(zip_strerror(impl_->archive), "a member that can be read");
  std::string bytes;
  int64_t got = 0;
  do {  // reads beyond the last byte too, where libzip compares the checksum
    const size_t at = bytes.size();
    bytes.resize(std::min<uint64_t>(at + kZipChunkBytes, stat.size + 1));
    got = zip_fread(file, bytes.data() + at, bytes.size() - at);
    bytes.resize(at + std::max<int64_t>(got, 0));
  } while (got > 0 && bytes.size() <= stat.size);
  const std::string reason = zip_file_strerror(file);
  zip_fclose(file);
  if (got < 0) return error(reason, "a member that is whole");
  if (bytes.size() != stat.size) {
    return error(absl::StrCat(bytes.size(), " bytes or more"), absl::StrCat(stat.size, ", as the archive states"));
  }
  return bytes;
}

std::string ZipFile::ReadHead(const std::string& member, int64_t max_bytes) {
  const auto found = impl_->index.find(member);
  zip_file_t* file = found == impl_->index.end() ? nullptr : zip_fopen_index(impl_->archive, found->second, 0);
  if (file == nullptr) return "";
  std::string bytes(max_bytes, '\0');
  bytes.resize(std::max<int64_t>(zip_fread(file, bytes.data(), bytes.size()), 0));
  zip_fclose(file);
  return bytes;
}

}  // namespace tessera

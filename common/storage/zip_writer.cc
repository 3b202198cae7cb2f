#include "common/storage/zip_writer.h"

#include <zip.h>

#include <cerrno>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

constexpr uint16_t kNoDosTime = 0, kFirstDosDate = 0x21;            // 1980-01-01
constexpr uint32_t kPlainFileAttributes = uint32_t{0100644} << 16;  // of Unix

Status AddMember(zip_t* archive, const std::string& folder, const std::string& member) {
  const std::string path = absl::StrCat(folder, "/", member);
  const auto error = [&] { return absl::InternalError(absl::StrCat(path, ": ", zip_strerror(archive))); };
  zip_source_t* const source = zip_source_file(archive, path.c_str(), 0, -1);
  if (source == nullptr) return error();
  const zip_int64_t index = zip_file_add(archive, member.c_str(), source, ZIP_FL_ENC_UTF_8);
  if (index < 0) {
    zip_source_free(source);
    return error();
  }
  if (zip_set_file_compression(archive, index, ZIP_CM_STORE, 0) != 0 ||
      zip_file_set_dostime(archive, index, kNoDosTime, kFirstDosDate, 0) != 0 ||
      zip_file_set_external_attributes(archive, index, 0, ZIP_OPSYS_UNIX, kPlainFileAttributes) != 0) {
    return error();
  }
  return absl::OkStatus();
}

}  // namespace

Status WriteStoredZip(const std::string& path, const std::string& folder, const std::vector<std::string>& members) {
  const std::string temporary = TemporaryBeside(path);
  int code = 0;
  zip_t* const archive = zip_open(temporary.c_str(), ZIP_CREATE | ZIP_EXCL, &code);
  if (archive == nullptr) return absl::InternalError(absl::StrCat(path, ": cannot create a zip archive, code ", code));
  Status status;
  for (const std::string& member : members) {
    status = AddMember(archive, folder, member);
    if (!status.ok()) break;
  }
  if (status.ok() && zip_close(archive) == 0) return RenameDurably(temporary, path);
  if (status.ok()) {
    zip_error_t* const error = zip_get_error(archive);
    status = zip_error_system_type(error) == ZIP_ET_SYS
                 ? FileError(zip_error_code_system(error), path)
                 : absl::InternalError(absl::StrCat(path, ": ", zip_error_strerror(error)));
  }
  zip_discard(archive);
  return status;
}

}  // namespace tessera

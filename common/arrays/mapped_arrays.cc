#include "common/arrays/mapped_arrays.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

constexpr size_t kBufferBytes = size_t{1} << 18;  // write buffer of each array

}  // namespace

StatusOr<MappedArrays> MappedArrays::Open(const std::string& path) {
  MappedArrays arrays;
  arrays.path_ = path;
  TESSERA_ASSIGN_OR_RETURN(arrays.file_, MappedFile::Open(path));
  TESSERA_ASSIGN_OR_RETURN(arrays.header_,
                           ParseArrayFileHeader({arrays.file_.data(), arrays.file_.size_bytes()}, path));
  return arrays;
}

StatusOr<const ArrayFileHeader::Entry*> MappedArrays::Find(const std::string& array, size_t type, int64_t count) const {
  for (const ArrayFileHeader::Entry& entry : header_.entries) {
    if (entry.name != array) continue;
    if (entry.type != type) {
      return absl::DataLossError(
          absl::StrCat(path_, ": array \"", array, "\": its value type differs from the expected one"));
    }
    if (count >= 0 && entry.count != static_cast<uint64_t>(count)) {
      return absl::DataLossError(
          absl::StrCat(path_, ": array \"", array, "\": found ", entry.count, " values, expected ", count));
    }
    return &entry;
  }
  return absl::DataLossError(absl::StrCat(path_, ": array \"", array, "\" is missing"));
}

Status MappedArrays::Verify(const std::string& array) const {
  for (const ArrayFileHeader::Entry& entry : header_.entries) {
    if (entry.name != array) continue;
    if (Xxh3(file_.data() + entry.offset, entry.count * ArrayFileHeader::value_bytes(entry)) == entry.hash) {
      return absl::OkStatus();
    }
    return absl::DataLossError(
        absl::StrCat(path_, ": byte ", entry.offset, ": found a wrong checksum, expected that of \"", array, "\""));
  }
  return absl::DataLossError(absl::StrCat(path_, ": array \"", array, "\" is missing"));
}

void MappedArrays::Release(const std::string& array) const {
  for (const ArrayFileHeader::Entry& entry : header_.entries) {
    if (entry.name == array) file_.Release(entry.offset, entry.count * ArrayFileHeader::value_bytes(entry));
  }
}

struct ArrayFileWriter::Region {
  Xxh3Hasher hasher;
  uint64_t written_bytes = 0;  // including the buffer
  std::string buffer;
};

StatusOr<std::unique_ptr<ArrayFileWriter>> ArrayFileWriter::Create(const std::string& path, const std::string& metadata,
                                                                   std::vector<Array> arrays) {
  std::unique_ptr<ArrayFileWriter> writer(new ArrayFileWriter());
  writer->path_ = path;
  writer->temporary_ = TemporaryBeside(path);
  writer->fd_ = open(writer->temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (writer->fd_ < 0) return FileError(errno, writer->temporary_);
  std::sort(arrays.begin(), arrays.end(), [](const Array& a, const Array& b) { return a.name < b.name; });
  writer->header_.metadata = metadata;
  for (const Array& array : arrays) {
    writer->header_.entries.push_back({array.name, array.type.index(), array.count, 0, 0});
  }
  writer->regions_.resize(arrays.size());
  writer->header_.LayOut();
  return writer;
}

ArrayFileWriter::~ArrayFileWriter() {
  if (fd_ < 0) return;
  close(fd_);
  unlink(temporary_.c_str());
}

void ArrayFileWriter::Fail(const Status& error) {
  const std::lock_guard lock(mutex_);
  status_.Update(error);
  failed_ = true;
}

void ArrayFileWriter::Write(uint64_t offset, const char* data, size_t size_bytes) {
  size_t done = 0;
  while (!failed_ && done < size_bytes) {
    const ssize_t wrote = pwrite(fd_, data + done, size_bytes - done, static_cast<off_t>(offset + done));
    if (wrote < 0 && errno != EINTR) Fail(FileError(errno, temporary_));
    if (wrote > 0) done += static_cast<size_t>(wrote);
  }
}

void ArrayFileWriter::AppendBytes(const std::string& name, size_t type, const void* data, size_t size_bytes) {
  const auto found =
      std::lower_bound(header_.entries.begin(), header_.entries.end(), name,
                       [](const ArrayFileHeader::Entry& entry, const std::string& of) { return entry.name < of; });
  const auto i = static_cast<size_t>(found - header_.entries.begin());
  if (i == regions_.size() || found->name != name || found->type != type) std::abort();
  Region& region = regions_[i];
  const char* bytes = static_cast<const char*>(data);
  region.hasher.Update(bytes, size_bytes);
  const ArrayFileHeader::Entry& entry = header_.entries[i];
  if (region.written_bytes + size_bytes > entry.count * ArrayFileHeader::value_bytes(entry)) {
    return Fail(absl::InternalError(absl::StrCat(path_, ": too many values of \"", name, "\"")));
  }
  const bool is_last =
      region.written_bytes + size_bytes == entry.count * ArrayFileHeader::value_bytes(entry);  // of the array
  if (region.buffer.size() + size_bytes > kBufferBytes || is_last) {
    Write(entry.offset + region.written_bytes - region.buffer.size(), region.buffer.data(), region.buffer.size());
    region.buffer.clear();
  }
  region.written_bytes += size_bytes;
  if (size_bytes > kBufferBytes || is_last) {
    Write(entry.offset + region.written_bytes - size_bytes, bytes, size_bytes);
  } else {
    region.buffer.append(bytes, size_bytes);
  }
  if (is_last) region.buffer = std::string();  // a file may have thousands of arrays
}

Status ArrayFileWriter::Finish() {
  for (size_t i = 0; i < regions_.size(); ++i) {
    ArrayFileHeader::Entry& entry = header_.entries[i];
    Region& region = regions_[i];
    Write(entry.offset + region.written_bytes - region.buffer.size(), region.buffer.data(), region.buffer.size());
    if (region.written_bytes != entry.count * ArrayFileHeader::value_bytes(entry)) {
      Fail(absl::InternalError(absl::StrCat(path_, ": found ", region.written_bytes, " bytes of \"", entry.name,
                                            "\", expected ", entry.count * ArrayFileHeader::value_bytes(entry))));
    }
    entry.hash = region.hasher.Digest();
  }
  const std::string header = header_.Serialize();
  Write(0, header.data(), header.size());
  if (!failed_ && ftruncate(fd_, static_cast<off_t>(header_.file_bytes)) != 0) Fail(FileError(errno, temporary_));
  if (!failed_ && fsync(fd_) != 0) Fail(FileError(errno, temporary_));
  TESSERA_RETURN_IF_ERROR(status_);
  TESSERA_RETURN_IF_ERROR(RenameDurably(temporary_, path_));
  close(fd_);
  fd_ = -1;
  return absl::OkStatus();
}

}  // namespace tessera

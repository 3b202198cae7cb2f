// The values of COLMAP's binary files.
#pragma once

#include <Eigen/Core>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap_entries.h"

namespace tessera {

static_assert(std::endian::native == std::endian::little, "COLMAP's binary files are little-endian");

// Reads values from a byte string. After reading beyond its end, ok() is false and all values are zero.
class ColmapByteReader {
 public:
  ColmapByteReader(const std::string& bytes, std::string file) : bytes_(bytes), file_(std::move(file)) {}

  template <class T>
  T Read() {
    T value{};
    if (Take(sizeof(T))) std::memcpy(&value, bytes_.data() + at_ - sizeof(T), sizeof(T));
    return value;
  }
  Eigen::Vector3d ReadVector3() {
    const double x = Read<double>(), y = Read<double>(), z = Read<double>();
    return {x, y, z};
  }
  std::string ReadName() {
    const size_t end = ok_ ? bytes_.find('\0', at_) : std::string::npos;
    if (end == std::string::npos) {
      ok_ = false;
      return "";
    }
    std::string name = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return name;
  }
  bool Skip(uint64_t count, uint64_t size_bytes) {
    ok_ = ok_ && count <= (bytes_.size() - at_) / size_bytes;
    return ok_ && Take(count * size_bytes);
  }
  bool CanHold(uint64_t count, uint64_t size_bytes) const { return count <= (bytes_.size() - at_) / size_bytes; }
  bool ok() const { return ok_; }
  size_t left() const { return bytes_.size() - at_; }
  ColmapLocation Location() const { return {file_, absl::StrCat("byte ", at_)}; }
  ColmapLocation EndLocation() const { return {file_, absl::StrCat("byte ", bytes_.size())}; }

  // Reads the number of entries, and checks that the file is large enough for them at `smallest_bytes` each.
  bool Count(uint64_t smallest_bytes, uint64_t* count, Faults* faults) {
    const ColmapLocation location = Location();
    *count = Read<uint64_t>();
    if (!ok_) {
      faults->Add(EndLocation().Error("the end of the file", "a number of entries"));
      return false;
    }
    if (!CanHold(*count, smallest_bytes)) {
      faults->Add(location.Error(absl::StrCat(*count, " entries"),
                                 absl::StrCat("at most ", left() / smallest_bytes, ", which fit in the file")));
      return false;
    }
    return true;
  }
  void Truncated(uint64_t entry, uint64_t count, const char* what, Faults* faults) const {
    faults->Add(EndLocation().Error("the end of the file", absl::StrCat(what, " ", entry + 1, " of ", count)));
  }
  void CheckEnd(Faults* faults) const {
    if (left() > 0) faults->Add(Location().Error(absl::StrCat(left(), " more bytes"), "the end of the file"));
  }

 private:
  bool Take(size_t size) {
    ok_ = ok_ && size <= bytes_.size() - at_;
    if (ok_) at_ += size;
    return ok_;
  }
  const std::string& bytes_;
  std::string file_;
  size_t at_ = 0;
  bool ok_ = true;
};

}  // namespace tessera

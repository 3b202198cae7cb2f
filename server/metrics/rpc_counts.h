// Counts RPCs by method, status code and duration.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace tessera {

// Thread-safe and lock-free, because it is on the path of every call.
class RpcCounts {
 public:
  static constexpr int kCodes = 18;  // gRPC's codes, and one for any other
  static constexpr std::array<double, 9> kBounds_s = {0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 10};

  struct OfMethod {
    std::string name;                                                     // "Jobs/CreateJob"; the last: "other"
    std::array<std::atomic<int64_t>, kCodes> codes = {};                  // calls
    std::array<std::atomic<int64_t>, kBounds_s.size() + 1> buckets = {};  // calls by seconds, not cumulative
    std::atomic<double> seconds = 0;
  };

  // `methods`: as gRPC names them, "/tessera.v1.Jobs/CreateJob". All others are counted as one.
  explicit RpcCounts(const std::vector<std::string>& methods);
  // The counter of a method, to be passed to Count.
  OfMethod& Of(std::string_view method);
  static void Count(OfMethod& method, int code, double seconds);
  void CountBlobBytes(int64_t read, int64_t written) {
    blob_bytes_read_ += read;
    blob_bytes_written_ += written;
  }

  const std::vector<std::unique_ptr<OfMethod>>& methods() const { return methods_; }
  // Bytes transferred through the blob service.
  int64_t blob_bytes_read() const { return blob_bytes_read_; }
  int64_t blob_bytes_written() const { return blob_bytes_written_; }

  // "OK", "INVALID_ARGUMENT", ...; "other" for the last.
  static std::string CodeName(int code);

 private:
  std::vector<std::string> names_;  // as gRPC names them
  std::vector<std::unique_ptr<OfMethod>> methods_;
  std::unordered_map<std::string_view, OfMethod*> of_name_;
  std::atomic<int64_t> blob_bytes_read_ = 0, blob_bytes_written_ = 0;
};

}  // namespace tessera

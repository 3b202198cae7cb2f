// An in-memory blob service with fault injection.
#pragma once

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/storage/hash.h"
#include "tessera/v1/blobs.grpc.pb.h"

namespace tessera {

class FakeBlobService : public v1::Blobs::Service {
 public:
  static constexpr int64_t kChunkBytes = 1 << 20;

  Digest Add(const std::string& bytes) {
    std::lock_guard lock(mutex_);
    const Digest digest{Sha256Hex(bytes), static_cast<int64_t>(bytes.size())};
    blobs_[digest.sha256] = bytes;
    return digest;
  }
  // Serves other bytes than the digest says.
  void Replace(const Digest& digest, const std::string& bytes) {
    std::lock_guard lock(mutex_);
    blobs_[digest.sha256] = bytes;
  }
  bool Holds(const Digest& digest) {
    std::lock_guard lock(mutex_);
    return blobs_.contains(digest.sha256);
  }
  std::string Content(const Digest& digest) {
    std::lock_guard lock(mutex_);
    return blobs_[digest.sha256];
  }
  // Each of the next `streams` streams breaks with UNAVAILABLE after `chunks` chunks.
  void BreakStreams(int streams, int chunks) {
    std::lock_guard lock(mutex_);
    streams_to_break_ = streams;
    chunks_before_break_ = chunks;
  }
  // The next `count` chunks that are read have a flipped bit.
  void DamageChunks(int count) {
    std::lock_guard lock(mutex_);
    chunks_to_damage_ = count;
  }
  // The next `count` uploads find no room: RESOURCE_EXHAUSTED.
  void RefuseUploads(int count) {
    std::lock_guard lock(mutex_);
    uploads_to_refuse_ = count;
  }
  // Streams of this blob are refused with PERMISSION_DENIED, once so many were refused before (20 s at most).
  void Forbid(const Digest& digest, int after = 0) {
    std::lock_guard lock(mutex_);
    forbidden_[digest.sha256] = after;
  }
  // The first streams wait until so many are open, 20 s at most.
  void GatherStreams(int streams) {
    std::lock_guard lock(mutex_);
    gathers_ = streams;
  }
  // Each stream waits this long before its first chunk.
  void DelayStreams(std::chrono::milliseconds delay) {
    std::lock_guard lock(mutex_);
    delay_ = delay;
  }
  int most_streams_at_once() {
    std::lock_guard lock(mutex_);
    return most_open_;
  }
  // Offsets that streams started from.
  std::vector<int64_t> read_offsets() {
    std::lock_guard lock(mutex_);
    return read_offsets_;
  }
  std::vector<int64_t> write_offsets() {
    std::lock_guard lock(mutex_);
    return write_offsets_;
  }

  grpc::Status ReadBlob(grpc::ServerContext*, const v1::ReadBlobRequest* request,
                        grpc::ServerWriter<v1::BlobChunk>* writer) override {
    if (IsForbidden(request->digest().sha256())) return grpc::Status(grpc::StatusCode::PERMISSION_DENIED, "not yours");
    const OpenStream open(*this);
    std::string bytes;
    {
      std::lock_guard lock(mutex_);
      read_offsets_.push_back(request->offset());
      const auto found = blobs_.find(request->digest().sha256());
      if (found == blobs_.end()) return grpc::Status(grpc::StatusCode::NOT_FOUND, "no such blob");
      bytes = found->second;
    }
    int chunks = 0;
    for (int64_t offset = request->offset(); offset < static_cast<int64_t>(bytes.size()); offset += kChunkBytes) {
      if (Breaks(chunks++)) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "told to break");
      v1::BlobChunk chunk;
      chunk.set_offset(offset);
      chunk.set_data(bytes.substr(offset, kChunkBytes));
      chunk.set_xxh3(Xxh3(chunk.data()));
      {
        std::lock_guard lock(mutex_);
        if (chunks_to_damage_ > 0) {
          --chunks_to_damage_;
          (*chunk.mutable_data())[0] ^= 1;
        }
      }
      if (!writer->Write(chunk)) break;
    }
    return grpc::Status::OK;
  }

  grpc::Status WriteBlob(grpc::ServerContext*, grpc::ServerReader<v1::WriteBlobRequest>* reader,
                         v1::WriteBlobResponse* response) override {
    const OpenStream open(*this);
    v1::WriteBlobRequest request;
    std::string sha256;
    int64_t size_bytes = 0;
    int chunks = 0;
    while (reader->Read(&request)) {
      const int64_t offset = request.chunk().offset();
      {
        std::lock_guard lock(mutex_);
        if (request.has_digest()) {
          sha256 = request.digest().sha256();
          size_bytes = request.digest().size_bytes();
          write_offsets_.push_back(offset);
        }
        if (Xxh3(request.chunk().data()) != request.chunk().xxh3()) {
          return grpc::Status(grpc::StatusCode::DATA_LOSS, "damaged chunk");
        }
        if (uploads_to_refuse_ > 0) {
          --uploads_to_refuse_;
          return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "no space left on device");
        }
      }
      if (Breaks(chunks++)) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "told to break");
      std::lock_guard lock(mutex_);
      std::string& partial = partial_[sha256];
      if (offset > static_cast<int64_t>(partial.size())) {
        return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION, "gap");
      }
      partial.resize(offset);
      partial += request.chunk().data();
    }
    std::lock_guard lock(mutex_);
    std::string& partial = partial_[sha256];
    response->set_committed_bytes(static_cast<int64_t>(partial.size()));
    if (static_cast<int64_t>(partial.size()) == size_bytes) {
      const bool whole = Sha256Hex(partial) == sha256;
      if (whole) blobs_[sha256] = partial;
      partial_.erase(sha256);
      if (!whole) return grpc::Status(grpc::StatusCode::DATA_LOSS, "does not hash to its digest");
    }
    return grpc::Status::OK;
  }

  grpc::Status QueryWrite(grpc::ServerContext*, const v1::QueryWriteRequest* request,
                          v1::QueryWriteResponse* response) override {
    std::lock_guard lock(mutex_);
    const auto held = blobs_.find(request->digest().sha256());
    response->set_complete(held != blobs_.end());
    response->set_committed_bytes(held != blobs_.end()
                                      ? request->digest().size_bytes()
                                      : static_cast<int64_t>(partial_[request->digest().sha256()].size()));
    return grpc::Status::OK;
  }

 private:
  class OpenStream {
   public:
    explicit OpenStream(FakeBlobService& service) : service_(service) {
      std::unique_lock lock(service_.mutex_);
      service_.most_open_ = std::max(service_.most_open_, ++service_.open_);
      service_.changed_.notify_all();
      service_.changed_.wait_for(lock, std::chrono::seconds(20),
                                 [&] { return service_.most_open_ >= service_.gathers_; });
      const auto delay = service_.delay_;
      lock.unlock();
      std::this_thread::sleep_for(delay);
    }
    ~OpenStream() {
      std::lock_guard lock(service_.mutex_);
      --service_.open_;
    }

   private:
    FakeBlobService& service_;
  };
  bool IsForbidden(const std::string& sha256) {
    std::unique_lock lock(mutex_);
    const auto forbidden = forbidden_.find(sha256);
    if (forbidden == forbidden_.end()) return false;
    const int after = forbidden->second;
    changed_.wait_for(lock, std::chrono::seconds(20), [&] { return refused_ >= after; });
    ++refused_;
    changed_.notify_all();
    return true;
  }
  bool Breaks(int chunks) {
    std::lock_guard lock(mutex_);
    if (streams_to_break_ == 0 || chunks < chunks_before_break_) return false;
    --streams_to_break_;
    return true;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, int> forbidden_;  // by SHA-256: refused before
  int refused_ = 0, gathers_ = 0, open_ = 0, most_open_ = 0;
  std::chrono::milliseconds delay_{0};
  std::map<std::string, std::string> blobs_;
  std::map<std::string, std::string> partial_;
  int streams_to_break_ = 0;
  int chunks_before_break_ = 0;
  int chunks_to_damage_ = 0;
  int uploads_to_refuse_ = 0;
  std::vector<int64_t> read_offsets_;
  std::vector<int64_t> write_offsets_;
};

}  // namespace tessera

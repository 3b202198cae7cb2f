// The contract of BlobStore over a folder and in memory. S3: tests/unit/common/s3_blobs.
#include "common/storage/blob_store.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <fstream>

#include "common/storage/folder_blobs.h"
#include "tests/support/blob_store_contract.h"
#include "tests/support/memory_blobs.h"

namespace tessera {
namespace {

constexpr int64_t kOld_us = 1'700'000'000'000'000;

class FolderCase : public StoreCase {
 public:
  BlobStore& store() override { return *store_; }
  void Reopen() override { store_ = *FolderBlobs::Open(folder_.path() + "/blobs"); }
  void Damage(const Digest& digest, const std::string& bytes) override {
    std::ofstream(*store_->LocalPath(digest), std::ios::binary) << bytes;
  }
  void MakeOld(const Digest& digest) override {
    const timespec time = {kOld_us / 1'000'000, 0}, times[] = {time, time};
    EXPECT_EQ(::utimensat(AT_FDCWD, store_->LocalPath(digest)->c_str(), times, 0), 0);
  }

 private:
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::unique_ptr<FolderBlobs> store_ = *FolderBlobs::Open(folder_.path() + "/blobs");
};

class MemoryCase : public StoreCase {
 public:
  BlobStore& store() override { return store_; }
  void Damage(const Digest& digest, const std::string& bytes) override { store_.Damage(digest, bytes); }
  void MakeOld(const Digest& digest) override { store_.SetTime(digest, kOld_us); }

 private:
  MemoryBlobs store_;
};

INSTANTIATE_TEST_SUITE_P(
    Stores, BlobStoreTest,
    testing::Values(BlobStoreImplementation{"Folder", [] { return std::make_unique<FolderCase>(); }},
                    BlobStoreImplementation{"Memory", [] { return std::make_unique<MemoryCase>(); }}),
    [](const testing::TestParamInfo<BlobStoreImplementation>& info) { return info.param.name; });

}  // namespace
}  // namespace tessera

#include "common/rpc/tls_certificates.h"

#include <fcntl.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/access/certificates.h"
#include "common/log/log.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr int kRefresh_s = 1;
constexpr int64_t kMaxPemBytes = 4 << 20;

// A file in memory with a fixed path, whose content is replaced atomically.
class MemoryFile {
 public:
  MemoryFile() = default;
  ~MemoryFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  // Empty before the first Replace.
  std::string path() const { return fd_ < 0 ? "" : absl::StrCat("/proc/self/fd/", fd_); }

  Status Replace(const std::string& content) {
    const int fd = ::memfd_create("tessera-tls", MFD_CLOEXEC);
    // gRPC compares the modification times in seconds before and after it reads key and certificate: each version has
    // another one, so gRPC never pairs a key with the certificate of another version.
    const timespec times[2] = {{++version_, 0}, {version_, 0}};
    bool good = fd >= 0 && ::ftruncate(fd, static_cast<off_t>(content.size())) == 0 &&
                ::pwrite(fd, content.data(), content.size(), 0) == static_cast<ssize_t>(content.size()) &&
                ::futimens(fd, times) == 0;
    if (good && fd_ < 0) {
      fd_ = fd;
      return absl::OkStatus();
    }
    good = good && ::dup3(fd, fd_, O_CLOEXEC) == fd_;
    const int error = errno;
    if (fd >= 0) ::close(fd);
    return good ? absl::OkStatus() : absl::ErrnoToStatus(error, "cannot keep a certificate in memory");
  }

 private:
  int fd_ = -1;
  time_t version_ = 0;
};

}  // namespace

struct TlsCertificates::Impl {
  // Reads the files and takes over what is complete and differs from what is in use. Returns the first error.
  Status Refresh() {
    Status status = files.certificate.empty() ? absl::OkStatus() : RefreshOwn();
    if (!files.authorities.empty()) status.Update(RefreshAuthorities());
    return status;
  }

  Status RefreshOwn() {
    TESSERA_ASSIGN_OR_RETURN(const std::string certificate, ReadFile(files.certificate, kMaxPemBytes));
    TESSERA_ASSIGN_OR_RETURN(const std::string key, ReadFile(files.key, kMaxPemBytes));
    // One file for both, so that they are replaced together: readers of PEM skip blocks of other kinds.
    const std::string both = absl::StrCat(key, "\n", certificate);
    if (both == own_content) return absl::OkStatus();
    TESSERA_RETURN_IF_ERROR(CheckCertificate(files.certificate, certificate, files.key, key));
    return Use(files.certificate, both, own_copy, own_content);
  }

  Status RefreshAuthorities() {
    TESSERA_ASSIGN_OR_RETURN(const std::string pem, ReadFile(files.authorities, kMaxPemBytes));
    if (pem == trusted_content) return absl::OkStatus();
    TESSERA_RETURN_IF_ERROR(CheckAuthorities(files.authorities, pem));
    return Use(files.authorities, pem, trusted_copy, trusted_content);
  }

  static Status Use(const std::string& file, const std::string& pem, MemoryFile& copy, std::string& content) {
    TESSERA_RETURN_IF_ERROR(copy.Replace(pem));
    if (!content.empty()) LogInfo("certificate renewed", {{"file", file}});
    content = pem;
    return absl::OkStatus();
  }

  void Follow(const std::stop_token& stop) {
    Status before, logged;
    std::unique_lock lock(mutex);
    while (!changed.wait_for(lock, stop, std::chrono::seconds(kRefresh_s), [&] { return stop.stop_requested(); })) {
      const Status now = Refresh();
      // An error that is seen once may be a renewal under way.
      if (now != logged && now == before) {
        logged = now;
        if (!now.ok()) LogWarning("renewed certificate not used", {{"error", std::string(now.message())}});
      }
      before = now;
    }
  }

  TlsFiles files;
  MemoryFile own_copy, trusted_copy;
  std::string own_content, trusted_content;  // in use
  std::shared_ptr<grpc::experimental::CertificateProviderInterface> provider;
  std::mutex mutex;
  std::condition_variable_any changed;
  std::jthread thread;  // last: it ends before the rest is destroyed
};

TlsCertificates::TlsCertificates(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TlsCertificates::~TlsCertificates() = default;

StatusOr<std::shared_ptr<TlsCertificates>> TlsCertificates::Open(const TlsFiles& files) {
  auto impl = std::make_unique<Impl>();
  impl->files = files;
  TESSERA_RETURN_IF_ERROR(impl->Refresh());
  const std::string own = impl->own_copy.path();
  impl->provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      own, own, impl->trusted_copy.path(), static_cast<unsigned>(kRefresh_s));
  impl->thread = std::jthread([&followed = *impl](const std::stop_token& stop) { followed.Follow(stop); });
  return std::shared_ptr<TlsCertificates>(new TlsCertificates(std::move(impl)));
}

const std::shared_ptr<grpc::experimental::CertificateProviderInterface>& TlsCertificates::provider() const {
  return impl_->provider;
}

TlsTexts TlsCertificates::texts() const {
  std::lock_guard lock(impl_->mutex);
  return {impl_->own_content, impl_->trusted_content};
}

}  // namespace tessera

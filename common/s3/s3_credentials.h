// Credentials of an S3 store, from where AWS's own tools read them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "common/base/clock.h"
#include "common/base/status.h"

namespace tessera {

struct S3Credentials {
  std::string access_key;
  std::string secret_key;
  std::string session_token;  // empty: none
  int64_t expires_us = 0;     // Unix time; 0: never
};

// Thread-safe.
class S3CredentialsSource {
 public:
  virtual ~S3CredentialsSource() = default;
  // Valid credentials. Renews temporary ones some minutes before they expire; if that fails, the old ones serve until
  // they expire. FAILED_PRECONDITION tells where credentials were looked for and why there are none. No secret is in
  // any message.
  virtual StatusOr<S3Credentials> Get() = 0;
};

// The first of: the environment (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN), the shared files
// (AWS_SHARED_CREDENTIALS_FILE, AWS_CONFIG_FILE) with the profile AWS_PROFILE, whose `credential_process` is run, and
// the container endpoint (AWS_CONTAINER_CREDENTIALS_FULL_URI or _RELATIVE_URI). Changed files are read again. Reads the
// environment now, and erases the secrets from it, so that child processes do not inherit them; a later call of the
// process gets what an earlier one erased. `clock` must outlive the source.
std::unique_ptr<S3CredentialsSource> DefaultS3Credentials(const Clock* clock);

// The same with these variables in place of the environment.
std::unique_ptr<S3CredentialsSource> S3CredentialsFrom(const std::map<std::string, std::string>& environment,
                                                       const Clock* clock);

// Always the same ones.
std::unique_ptr<S3CredentialsSource> FixedS3Credentials(const S3Credentials& credentials);

// Reads what a credential_process or a container endpoint answers. INVALID_ARGUMENT names `what`, and no value.
StatusOr<S3Credentials> ParseS3Credentials(const std::string& what, const std::string& json);

}  // namespace tessera

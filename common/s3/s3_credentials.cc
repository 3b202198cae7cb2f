#include "common/s3/s3_credentials.h"

#include <openssl/crypto.h>

#include <algorithm>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "common/base/json_bounds.h"
#include "common/base/printable.h"
#include "common/base/retry/retry.h"
#include "common/s3/aws_profile.h"
#include "common/s3/credential_process.h"
#include "common/s3/http_client.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Environment = std::map<std::string, std::string>;

constexpr int64_t kRenewBeforeUs = int64_t{5} * 60 * 1'000'000;
constexpr int64_t kRetryAfterUs = int64_t{10} * 1'000'000;  // between attempts of a renewal that fails
constexpr double kProcessSeconds = 60;
constexpr int64_t kMaxProfileBytes = 1 << 20;
constexpr char kContainerHost[] = "http://169.254.170.2";  // of Amazon ECS
const char* const kReadVariables[] = {"AWS_ACCESS_KEY_ID",
                                      "AWS_SECRET_ACCESS_KEY",
                                      "AWS_SESSION_TOKEN",
                                      "AWS_SHARED_CREDENTIALS_FILE",
                                      "AWS_CONFIG_FILE",
                                      "AWS_PROFILE",
                                      "AWS_CONTAINER_CREDENTIALS_FULL_URI",
                                      "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
                                      "AWS_CONTAINER_AUTHORIZATION_TOKEN",
                                      "AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE",
                                      "HOME"};
const char* const kErasedVariables[] = {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN",
                                        "AWS_CONTAINER_AUTHORIZATION_TOKEN"};

std::string ValueOf(const Environment& environment, const std::string& name) {
  const auto found = environment.find(name);
  return found == environment.end() ? "" : found->second;
}

// In headers.
bool MayBeSent(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c < 127; });
}

Status CheckCredentials(const std::string& what, const S3Credentials& credentials) {
  if (credentials.access_key.empty() || credentials.secret_key.empty()) {
    return InputError(what, "", "no access key or no secret key", "both");
  }
  if (!MayBeSent(credentials.access_key) || !MayBeSent(credentials.secret_key) ||
      !MayBeSent(credentials.session_token)) {
    return InputError(what, "", "a key or a token with blanks or control characters", "printable characters");
  }
  return absl::OkStatus();
}

// A way to get credentials.
class Provider {
 public:
  virtual ~Provider() = default;
  // Nullopt if this way is not set up.
  virtual StatusOr<std::optional<S3Credentials>> Fetch() = 0;
  // For a message: where it looks.
  virtual std::string Where() const = 0;
  // Whether it may have others than before, though those are still valid.
  virtual bool Changed() { return false; }
};

class EnvironmentProvider : public Provider {
 public:
  explicit EnvironmentProvider(const Environment& environment)
      : credentials_{ValueOf(environment, "AWS_ACCESS_KEY_ID"), ValueOf(environment, "AWS_SECRET_ACCESS_KEY"),
                     ValueOf(environment, "AWS_SESSION_TOKEN"), 0} {}
  StatusOr<std::optional<S3Credentials>> Fetch() override {
    if (credentials_.access_key.empty() && credentials_.secret_key.empty()) return std::nullopt;
    TESSERA_RETURN_IF_ERROR(CheckCredentials("AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY", credentials_));
    return credentials_;
  }
  std::string Where() const override { return "the environment (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY)"; }

 private:
  const S3Credentials credentials_;
};

class ProfileProvider : public Provider {
 public:
  explicit ProfileProvider(const Environment& environment)
      : credentials_file_(FileOf(environment, "AWS_SHARED_CREDENTIALS_FILE", "/.aws/credentials")),
        config_file_(FileOf(environment, "AWS_CONFIG_FILE", "/.aws/config")),
        asked_(ValueOf(environment, "AWS_PROFILE")),
        profile_(asked_.empty() ? "default" : asked_) {}

  StatusOr<std::optional<S3Credentials>> Fetch() override {
    stamps_ = Stamps();
    std::optional<std::string> process;
    bool found = false;
    for (const std::string& file : {credentials_file_, config_file_}) {
      if (file.empty() || !FileExists(file)) continue;
      TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file, kMaxProfileBytes));
      TESSERA_ASSIGN_OR_RETURN(AwsProfile profile, ParseAwsProfile(file, text, profile_));
      found = found || !profile.empty();
      if (profile.contains("aws_access_key_id") || profile.contains("aws_secret_access_key")) {
        const S3Credentials credentials{profile["aws_access_key_id"], profile["aws_secret_access_key"],
                                        profile["aws_session_token"], 0};
        TESSERA_RETURN_IF_ERROR(CheckCredentials(Place(file), credentials));
        return credentials;
      }
      if (!process && profile.contains("credential_process")) process = profile["credential_process"];
    }
    if (process) {
      TESSERA_ASSIGN_OR_RETURN(const std::string output, RunCredentialProcess(*process, kProcessSeconds));
      TESSERA_ASSIGN_OR_RETURN(S3Credentials credentials,
                               ParseS3Credentials("credential_process of profile '" + profile_ + "'", output));
      return credentials;
    }
    if (found) {
      return absl::FailedPreconditionError(
          absl::StrCat("profile '", Printable(profile_),
                       "' has neither aws_access_key_id nor credential_process; for roles and single sign-on, set "
                       "credential_process to a command such as 'aws configure export-credentials'"));
    }
    if (!asked_.empty()) {
      return absl::FailedPreconditionError(absl::StrCat("no profile '", Printable(profile_), "' (AWS_PROFILE) in ",
                                                        credentials_file_, " and ", config_file_));
    }
    return std::nullopt;
  }
  std::string Where() const override {
    return absl::StrCat("profile '", Printable(profile_), "' of ", credentials_file_, " and ", config_file_);
  }
  bool Changed() override { return stamps_ != Stamps(); }

 private:
  static std::string FileOf(const Environment& environment, const char* variable, const char* below_home) {
    if (const std::string file = ValueOf(environment, variable); !file.empty()) return file;
    const std::string home = ValueOf(environment, "HOME");
    return home.empty() ? "" : home + below_home;
  }
  std::string Place(const std::string& file) const {
    return absl::StrCat(file, ", profile '", Printable(profile_), "'");
  }
  std::vector<FileStamp> Stamps() const {
    std::vector<FileStamp> stamps;
    for (const std::string& file : {credentials_file_, config_file_}) {
      stamps.push_back(StampOf(file).value_or(FileStamp()));
    }
    return stamps;
  }

  const std::string credentials_file_, config_file_, asked_, profile_;
  std::vector<FileStamp> stamps_;
};

class ContainerProvider : public Provider {
 public:
  explicit ContainerProvider(const Environment& environment)
      : url_(ValueOf(environment, "AWS_CONTAINER_CREDENTIALS_FULL_URI")),
        token_(ValueOf(environment, "AWS_CONTAINER_AUTHORIZATION_TOKEN")),
        token_file_(ValueOf(environment, "AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE")),
        http_({.ca_file = "", .connect_s = 2, .silence_s = 5, .use_proxy = false}) {
    const std::string relative = ValueOf(environment, "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI");
    if (!relative.empty()) url_ = kContainerHost + relative;
  }

  StatusOr<std::optional<S3Credentials>> Fetch() override {
    if (url_.empty()) return std::nullopt;
    TESSERA_RETURN_IF_ERROR(CheckUrl());
    HttpRequest request;
    request.url = url_;
    request.max_answer_bytes = kMaxCredentialBytes;
    std::string token = token_;
    if (!token_file_.empty()) {
      TESSERA_ASSIGN_OR_RETURN(token, ReadFile(token_file_, kMaxCredentialBytes));
      while (token.ends_with("\n") || token.ends_with("\r")) token.pop_back();
    }
    if (!token.empty()) request.headers["authorization"] = token;
    HttpAnswer answer;
    TESSERA_RETURN_IF_ERROR(Retry({.max_attempts = 3}, Idempotency::kOnce, RealSleeper(), [&]() -> Status {
      TESSERA_ASSIGN_OR_RETURN(answer, http_.Send(request));
      return answer.status >= 500 ? absl::UnavailableError(absl::StrCat("HTTP ", answer.status)) : absl::OkStatus();
    }));
    if (answer.status != 200) {
      return absl::FailedPreconditionError(absl::StrCat(Where(), " answers with HTTP status ", answer.status));
    }
    TESSERA_ASSIGN_OR_RETURN(S3Credentials credentials, ParseS3Credentials(Where(), answer.body));
    return credentials;
  }
  std::string Where() const override {
    return "the container endpoint (AWS_CONTAINER_CREDENTIALS_FULL_URI or _RELATIVE_URI)";
  }

 private:
  // As AWS's tools do: the token goes over TLS, or to this machine and the addresses of Amazon ECS and EKS.
  Status CheckUrl() const {
    if (url_.starts_with("https://")) return absl::OkStatus();
    for (const std::string host :
         {"127.0.0.1", "localhost", "[::1]", "169.254.170.2", "169.254.170.23", "[fd00:ec2::23]"}) {
      const std::string start = "http://" + host;
      if (url_.starts_with(start + "/") || url_.starts_with(start + ":")) return absl::OkStatus();
    }
    return absl::FailedPreconditionError(
        "AWS_CONTAINER_CREDENTIALS_FULL_URI must be https, or http at this machine or at Amazon's own addresses");
  }

  std::string url_;
  const std::string token_, token_file_;
  const HttpClient http_;
};

// The first provider that is set up. One thread renews while others use what they have.
class RenewedCredentials : public S3CredentialsSource {
 public:
  RenewedCredentials(const Environment& environment, const Clock* clock) : clock_(clock) {
    providers_.push_back(std::make_unique<EnvironmentProvider>(environment));
    providers_.push_back(std::make_unique<ProfileProvider>(environment));
    providers_.push_back(std::make_unique<ContainerProvider>(environment));
  }

  StatusOr<S3Credentials> Get() override {
    std::unique_lock lock(mutex_);
    while (true) {
      if (!MustRenew()) return *current_;
      if (!renewing_) break;
      if (Valid()) return *current_;
      renewed_.wait(lock);
    }
    if (error_ && !Valid() && clock_->MonotonicUs() < retry_us_) return *error_;
    renewing_ = true;
    lock.unlock();
    StatusOr<S3Credentials> fetched = Fetch();
    lock.lock();
    renewing_ = false;
    renewed_.notify_all();
    if (fetched.ok()) {
      error_.reset();
      current_ = *std::move(fetched);
      const int64_t life_us = current_->expires_us - clock_->UnixTimeUs();
      renew_us_ = current_->expires_us - std::min(kRenewBeforeUs, life_us / 4);
      return *current_;
    }
    error_ = fetched.status();
    retry_us_ = clock_->MonotonicUs() + kRetryAfterUs;
    if (Valid()) return *current_;
    return *error_;
  }

 private:
  bool Valid() const { return current_ && (current_->expires_us == 0 || clock_->UnixTimeUs() < current_->expires_us); }
  // A renewal that failed is tried again after a while.
  bool MustRenew() {
    if (!Valid()) return true;
    const bool wanted = (current_->expires_us != 0 && clock_->UnixTimeUs() >= renew_us_) ||
                        (used_ != nullptr && !renewing_ && used_->Changed());
    return wanted && (!error_ || clock_->MonotonicUs() >= retry_us_);
  }
  // Called by one thread at a time.
  StatusOr<S3Credentials> Fetch() {
    std::string places;
    for (const std::unique_ptr<Provider>& provider : providers_) {
      StatusOr<std::optional<S3Credentials>> credentials = provider->Fetch();
      if (!credentials.ok()) {
        return absl::FailedPreconditionError(
            absl::StrCat("no S3 credentials: ", std::string(credentials.status().message())));
      }
      if (*credentials) {
        if ((*credentials)->expires_us != 0 && (*credentials)->expires_us <= clock_->UnixTimeUs()) {
          return absl::FailedPreconditionError(
              absl::StrCat("no S3 credentials: those of ", provider->Where(), " have expired"));
        }
        used_ = provider.get();
        return **credentials;
      }
      absl::StrAppend(&places, places.empty() ? "" : ", ", provider->Where());
    }
    return absl::FailedPreconditionError("no S3 credentials: there are none in " + places);
  }

  const Clock* const clock_;
  std::vector<std::unique_ptr<Provider>> providers_;
  std::mutex mutex_;
  std::condition_variable renewed_;
  bool renewing_ = false;
  std::optional<S3Credentials> current_;
  int64_t renew_us_ = 0;         // Unix time
  std::optional<Status> error_;  // of the last renewal, if it failed
  int64_t retry_us_ = 0;         // monotonic
  Provider* used_ = nullptr;     // where current_ is from
};

class FixedCredentials : public S3CredentialsSource {
 public:
  explicit FixedCredentials(const S3Credentials& credentials) : credentials_(credentials) {}
  StatusOr<S3Credentials> Get() override { return credentials_; }

 private:
  const S3Credentials credentials_;
};

// Reads the variables and erases the secret ones, also from the memory that /proc/PID/environ shows.
Environment TakeEnvironment() {
  static std::mutex mutex;
  static Environment& erased = *new Environment;
  const std::lock_guard lock(mutex);
  Environment environment;
  for (const char* name : kReadVariables) {
    if (const char* value = std::getenv(name)) environment[name] = value;
  }
  if (environment.contains("AWS_ACCESS_KEY_ID") || environment.contains("AWS_CONTAINER_AUTHORIZATION_TOKEN")) {
    erased.clear();
  }
  for (const char* name : kErasedVariables) {
    char* value = std::getenv(name);
    if (value == nullptr) continue;
    erased[name] = value;
    OPENSSL_cleanse(value, std::strlen(value));
    ::unsetenv(name);
  }
  environment.insert(erased.begin(), erased.end());
  return environment;
}

}  // namespace

StatusOr<S3Credentials> ParseS3Credentials(const std::string& what, const std::string& json) {
  if (static_cast<int64_t>(json.size()) > kMaxCredentialBytes) {
    return InputError(what, "", "too many bytes", absl::StrCat("at most ", kMaxCredentialBytes));
  }
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(what, json));
  const nlohmann::json parsed = nlohmann::json::parse(json, nullptr, false);
  if (!parsed.is_object()) return InputError(what, "", "no JSON object", "one with AccessKeyId and SecretAccessKey");
  const auto text = [&](const char* name) {
    const auto found = parsed.find(name);
    return found != parsed.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  S3Credentials credentials{text("AccessKeyId"), text("SecretAccessKey"), text("SessionToken"), 0};
  if (credentials.session_token.empty()) credentials.session_token = text("Token");  // of the container endpoint
  TESSERA_RETURN_IF_ERROR(CheckCredentials(what, credentials));
  if (const std::string expiration = text("Expiration"); !expiration.empty()) {
    absl::Time time;
    std::string error;
    if (!absl::ParseTime(absl::RFC3339_full, expiration, &time, &error)) {
      return InputError(what, "Expiration", "no time", "such as 2026-05-24T00:00:00Z");
    }
    credentials.expires_us = absl::ToUnixMicros(time);
  }
  return credentials;
}

std::unique_ptr<S3CredentialsSource> S3CredentialsFrom(const std::map<std::string, std::string>& environment,
                                                       const Clock* clock) {
  return std::make_unique<RenewedCredentials>(environment, clock);
}

std::unique_ptr<S3CredentialsSource> DefaultS3Credentials(const Clock* clock) {
  return S3CredentialsFrom(TakeEnvironment(), clock);
}

std::unique_ptr<S3CredentialsSource> FixedS3Credentials(const S3Credentials& credentials) {
  return std::make_unique<FixedCredentials>(credentials);
}

}  // namespace tessera

// What an S3 store delivers through Tessera's client, beside curl on the same machine and store.
//   store_bench --s3 s3://BUCKET/PREFIX --s3-endpoint http://127.0.0.1:PORT [--mb 1000] [--rounds 3] [--delay-ms 20]
// Credentials as of tesserad. Prints seconds and ratios; all objects are removed again. The delay is added in both
// directions together by a proxy in this process.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/clock.h"
#include "common/base/random.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_credentials.h"
#include "common/s3/s3_location.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "common/storage/temporary_name.h"
#include "tests/bench/or_exit.h"
#include "tests/e2e/tcp_proxy.h"

namespace tessera {
namespace {

constexpr double kUrl_s = 3600;

std::string RandomBytes(int64_t size, uint64_t seed) {
  Random random(seed);
  std::string bytes(static_cast<size_t>(size), '\0');
  for (char& byte : bytes) byte = static_cast<char>(random.Bits());
  return bytes;
}

// Runs curl with a signed request. Its options are in a file, so that the URL is not in the list of processes.
void Curl(const SignedRequest& request, const std::string& folder, const std::string& options) {
  const std::string file = folder + "/curl";
  {
    std::ofstream config(file);
    config << "url = \"" << request.url << "\"\nsilent\nfail\n" << options << "\n";
    for (const auto& [name, value] : request.headers) config << "header = \"" << name << ": " << value << "\"\n";
  }
  if (std::system(("curl -K '" + file + "'").c_str()) != 0) Check(absl::InternalError("curl failed"));
}

// One stream of one large object, by a signed URL, as a worker moves it: our seconds and curl's, the best of the
// rounds.
void OneStream(S3Client& client, const std::string& folder, int64_t bytes, int rounds) {
  const std::string path = folder + "/large", key = "large";
  Check(WriteFileAtomic(path, RandomBytes(bytes, 1)));
  const Digest digest = Value(HashFile(path));
  SignedTransfers transfers;
  double put_s = 1e9, curl_put_s = 1e9, get_s = 1e9, curl_get_s = 1e9;
  for (int round = 0; round < rounds; ++round) {
    const SignedRequest put = Value(client.SignPut(key, digest.sha256, bytes, kUrl_s));
    put_s = std::min(put_s, Seconds([&] { Check(transfers.Put(put, path, 0, bytes).status()); }));
    curl_put_s = std::min(
        curl_put_s, Seconds([&] { Curl(put, folder, "upload-file = \"" + path + "\"\noutput = \"/dev/null\""); }));
    const SignedRequest get = Value(client.SignGet(key, kUrl_s));
    int64_t received = 0;
    get_s = std::min(get_s, Seconds([&] {
                       Check(transfers.Get(get, 0, [&](std::string_view part) {
                         received += static_cast<int64_t>(part.size());
                         return absl::OkStatus();
                       }));
                     }));
    if (received != bytes) Check(absl::DataLossError("received another number of bytes"));
    curl_get_s = std::min(curl_get_s, Seconds([&] { Curl(get, folder, "output = \"/dev/null\""); }));
  }
  std::printf("one stream, %.0f MB: put %.2f s, curl %.2f s, ratio %.2f; get %.2f s, curl %.2f s, ratio %.2f\n",
              static_cast<double>(bytes) / 1e6, put_s, curl_put_s, curl_put_s / put_s, get_s, curl_get_s,
              curl_get_s / get_s);
  Check(client.Delete({key}));
}

// Seconds to read all objects by signed URLs, `streams` at once.
double ReadAll(const std::vector<SignedRequest>& requests, int streams) {
  SignedTransfers transfers;
  return Seconds([&] {
    std::atomic<size_t> next = 0;
    std::vector<std::jthread> threads;
    for (int stream = 0; stream < streams; ++stream) {
      threads.emplace_back([&] {
        for (size_t i; (i = next++) < requests.size();) {
          Check(transfers.Get(requests[i], 0, [](std::string_view) { return absl::OkStatus(); }));
        }
      });
    }
  });
}

// Stores `count` objects, and signs URLs through the proxy.
std::vector<SignedRequest> ManyObjects(S3Client& client, S3Client& through_proxy, int count, int64_t bytes,
                                       std::vector<std::string>& keys) {
  std::vector<SignedRequest> requests;
  for (int i = 0; i < count; ++i) {
    const std::string content = RandomBytes(bytes, static_cast<uint64_t>(i) + 2);
    keys.push_back(absl::StrCat("object-", bytes, "-", i));
    Check(client.Put(keys.back(), content, Sha256Hex(content)));
    requests.push_back(Value(through_proxy.SignGet(keys.back(), kUrl_s)));
  }
  return requests;
}

int Main(int argc, char** argv) {
  std::string url, endpoint;
  double megabytes = 1000, delay_ms = 20;
  int rounds = 3;
  CLI::App app("Measure an S3 store", "store_bench");
  app.add_option("--s3", url, "s3://BUCKET/PREFIX")->required();
  app.add_option("--s3-endpoint", endpoint, "Its address, http://127.0.0.1:PORT")->required();
  app.add_option("--mb", megabytes, "Size of the large object, MB");
  app.add_option("--rounds", rounds, "The best of so many rounds is printed");
  app.add_option("--delay-ms", delay_ms, "Delay of a round trip, milliseconds");
  CLI11_PARSE(app, argc, argv);
  SystemClock clock;
  const auto credentials = DefaultS3Credentials(&clock);
  S3Location location = Value(ParseS3Url(url, endpoint, "us-east-1"));
  location.prefix += UniqueName() + "/";
  const auto client = Value(S3Client::Create(location, credentials.get(), &clock));
  e2e::TcpProxy proxy(endpoint.substr(endpoint.find("://") + 3));
  proxy.SetDelay(delay_ms / 2000);
  S3Location far = location;
  far.endpoint = "http://" + proxy.address();
  const auto through_proxy = Value(S3Client::Create(far, credentials.get(), &clock));
  const TempFolder folder = Value(TempFolder::Create(""));

  if (megabytes > 0) OneStream(*client, folder.path(), static_cast<int64_t>(megabytes * 1e6), rounds);
  std::vector<std::string> keys;
  const auto files = ManyObjects(*client, *through_proxy, 64, 1'000'000, keys);
  const auto inputs = ManyObjects(*client, *through_proxy, 50, 200'000, keys);
  double one_s = 1e9, eight_s = 1e9, inputs_s = 1e9;
  for (int round = 0; round < rounds; ++round) {
    one_s = std::min(one_s, ReadAll(files, 1));
    eight_s = std::min(eight_s, ReadAll(files, 8));
    inputs_s = std::min(inputs_s, ReadAll(inputs, 16));
  }
  std::printf("64 files of 1 MB through %.0f ms: one stream %.2f s, eight %.2f s, ratio %.1f\n", delay_ms, one_s,
              eight_s, one_s / eight_s);
  std::printf("inputs of a step, 50 files of 200 KB through %.0f ms, 16 streams: %.3f s\n", delay_ms, inputs_s);
  Check(client->Delete(keys));
  return 0;
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) { return tessera::Main(argc, argv); }

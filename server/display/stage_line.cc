#include "server/display/stage_line.h"

#include <unistd.h>

#include <cstdio>

namespace tessera {

StageLine::StageLine(bool enabled)
    : shown_(enabled && isatty(STDERR_FILENO)), start_(std::chrono::steady_clock::now()) {}

StageLine::~StageLine() {
  if (shown_) std::fprintf(stderr, "\r\033[K");
}

void StageLine::Show(double fraction, const std::string& stage) {
  if (!shown_) return;
  std::lock_guard<std::mutex> lock(mutex_);
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  if (elapsed_s - last_s_ < 0.1) return;
  last_s_ = elapsed_s;
  const int filled = static_cast<int>(30 * fraction);
  std::fprintf(stderr, "\r\033[K[%s%s] %3.0f %%  %s", std::string(filled, '#').c_str(),
               std::string(30 - filled, '.').c_str(), 100 * fraction, stage.c_str());
  if (fraction > 0.05) std::fprintf(stderr, "  %.0f s left", elapsed_s * (1 - fraction) / fraction);
  std::fflush(stderr);
}

}  // namespace tessera

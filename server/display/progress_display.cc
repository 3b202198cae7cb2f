#include "server/display/progress_display.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "common/base/printable.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr int kBarWidth = 30;
constexpr size_t kMaxTaskLines = 12;

bool IsTerminal(std::FILE* out) {
  const char* kind = std::getenv("TERM");
  return isatty(fileno(out)) == 1 && kind != nullptr && std::strcmp(kind, "dumb") != 0;
}

int Width(std::FILE* out) {
  winsize size = {};
  return ioctl(fileno(out), TIOCGWINSZ, &size) == 0 && size.ws_col > 20 ? size.ws_col : 80;
}

int Percent(double fraction) {
  return std::isfinite(fraction) ? static_cast<int>(100 * std::clamp(fraction, 0.0, 1.0)) : 0;
}

// "workers/1-2" as "worker 1-2".
std::string WorkerLabel(const std::string& name) {
  std::string words = name;
  if (name.rfind("workers/", 0) == 0) words.erase(6, 1)[6] = ' ';
  return words;
}

std::string JobLine(const v1::Job& job) {
  std::string line = std::to_string(Percent(job.progress())) + "%";
  if (job.tiles_total() > 0) {
    line += "  tiles " + std::to_string(job.tiles_done()) + "/" + std::to_string(job.tiles_total());
  }
  line += "  tasks " + std::to_string(job.tasks_done()) + "/" + std::to_string(job.tasks_total());
  if (HasEnded(job.state())) return line + "  " + JobStateName(job.state());
  if (job.paused()) return line + "  paused";
  if (job.state() == v1::JOB_STATE_QUEUED) return line + "  queued";
  if (job.eta_s() >= 0) line += "  " + FormatDuration(job.eta_s()) + " to go";
  return line;
}

std::string TaskLine(const v1::Task& task) {
  std::string line = WorkerLabel(task.worker()) + ": " + task.title();
  if (task.attempt() > 1) line += " (attempt " + std::to_string(task.attempt()) + ")";
  line += ' ';
  line += std::to_string(Percent(task.progress())) + "%";
  if (!task.stage().empty()) line += "  " + task.stage();
  return line;
}

}  // namespace

ProgressDisplay::ProgressDisplay(std::FILE* out) : out_(out), terminal_(IsTerminal(out)) {}

std::vector<std::string> ProgressDisplay::RenderLines(const v1::WatchJobResponse& update, int width) {
  std::vector<std::string> lines;
  const int filled = Percent(update.job().progress()) * kBarWidth / 100;
  std::string bar(size_t{kBarWidth + 2}, '.');
  bar.front() = '[';
  bar.back() = ']';
  std::fill_n(bar.begin() + 1, filled, '#');
  bar += "  ";
  bar += JobLine(update.job());
  lines.push_back(bar);
  if (update.running().empty() && !update.job().waiting_for().empty()) {
    lines.emplace_back("  ").append(update.job().waiting_for());
  }
  for (const v1::Task& task : update.running()) {
    if (lines.size() > kMaxTaskLines) {
      lines.emplace_back("  and ").append(std::to_string(update.running_size() - kMaxTaskLines)).append(" more");
      break;
    }
    lines.emplace_back("  ").append(TaskLine(task));
  }
  for (std::string& line : lines) {
    line = Printable(line);
    line.resize(Prefix(line, static_cast<size_t>(std::max(0, width))).size());
  }
  return lines;
}

void ProgressDisplay::Show(const v1::WatchJobResponse& update) {
  if (!terminal_) return ShowPlain(update);
  Erase();
  shown_ = RenderLines(update, Width(out_) - 1);
  Draw();
}

void ProgressDisplay::Note(const std::string& line) {
  const std::vector<std::string> kept = shown_;
  Erase();
  std::fprintf(out_, "%s\n", PrintableLines(line).c_str());
  shown_ = kept;
  Draw();
}

void ProgressDisplay::Finish() {
  shown_.clear();
  std::fflush(out_);
}

void ProgressDisplay::Erase() {
  if (!shown_.empty()) std::fprintf(out_, "\x1b[%zuA\x1b[J", shown_.size());
  shown_.clear();
}

void ProgressDisplay::Draw() {
  for (const std::string& line : shown_) std::fprintf(out_, "%s\n", line.c_str());
  std::fflush(out_);
}

// Prints a line when the state changes, a task starts, a tile is finished, or progress passes another 10 %.
void ProgressDisplay::ShowPlain(const v1::WatchJobResponse& update) {
  const v1::Job& job = update.job();
  for (const v1::Task& task : update.running()) {
    int& printed = printed_attempts_[task.name()];
    if (printed == task.attempt()) continue;
    printed = task.attempt();
    const std::string attempt = printed > 1 ? " (attempt " + std::to_string(printed) + ")" : "";
    std::fprintf(out_, "%s: %s%s\n", WorkerLabel(task.worker()).c_str(), Printable(task.title()).c_str(),
                 attempt.c_str());
  }
  const int tenth = Percent(job.progress()) / 10;
  if (job.state() != last_state_ || job.paused() != last_paused_ || job.tiles_done() != last_tiles_ ||
      tenth > last_tenth_) {
    std::fprintf(out_, "%s: %s  %s\n", job.name().c_str(), JobStatusName(job).c_str(), JobLine(job).c_str());
  }
  // Compare without digits: numbers in the text change with time.
  std::string waiting = update.running().empty() ? job.waiting_for() : "";
  std::erase_if(waiting, [](char c) { return c >= '0' && c <= '9'; });
  if (!waiting.empty() && waiting != last_waiting_) {
    std::fprintf(out_, "%s: %s\n", job.name().c_str(), Printable(job.waiting_for()).c_str());
  }
  last_waiting_ = waiting;
  last_state_ = job.state();
  last_paused_ = job.paused();
  last_tiles_ = job.tiles_done();
  last_tenth_ = tenth;
  std::fflush(out_);
}

}  // namespace tessera

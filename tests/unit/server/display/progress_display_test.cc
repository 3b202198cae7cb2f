#include "server/display/progress_display.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

using testing::Each;
using testing::HasSubstr;
using testing::Not;

v1::WatchJobResponse Update(double progress, int running) {
  v1::WatchJobResponse update;
  update.mutable_job()->set_name("jobs/7");
  update.mutable_job()->set_state(v1::JOB_STATE_RUNNING);
  update.mutable_job()->set_progress(progress);
  update.mutable_job()->set_tiles_done(3);
  update.mutable_job()->set_tiles_total(8);
  update.mutable_job()->set_eta_s(200);
  for (int i = 0; i < running; ++i) {
    v1::Task* task = update.add_running();
    task->set_name("jobs/7/tasks/" + std::to_string(i));
    task->set_title("refine tile " + std::to_string(i));
    task->set_worker("workers/1-" + std::to_string(i));
    task->set_attempt(i + 1);
    task->set_progress(0.5);
    task->set_stage("level 1,\nstep 3");
  }
  return update;
}

TEST(ProgressDisplayTest, ShowsTilesTimeLeftAndRunningTasks) {
  const auto lines = ProgressDisplay::RenderLines(Update(0.5, 2), 120);
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_THAT(lines[0], HasSubstr("[###############...............]"));
  EXPECT_THAT(lines[0], HasSubstr("50%"));
  EXPECT_THAT(lines[0], HasSubstr("tiles 3/8"));
  EXPECT_THAT(lines[0], HasSubstr("3 min 20 s to go"));
  EXPECT_THAT(lines[1], HasSubstr("worker 1-0: refine tile 0"));
  EXPECT_THAT(lines[1], Not(HasSubstr("attempt")));
  EXPECT_THAT(lines[2], HasSubstr("(attempt 2)"));
}

TEST(ProgressDisplayTest, LinesFitTheTerminal) {
  for (const double progress : {-1.0, 0.0, 1.0, 7.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    const auto lines = ProgressDisplay::RenderLines(Update(progress, 100), 40);
    EXPECT_LE(lines.size(), 14u);
    for (const std::string& line : lines) {
      EXPECT_LE(line.size(), 40u);
      EXPECT_EQ(line.find('\n'), std::string::npos);
    }
  }
}

TEST(ProgressDisplayTest, PlainLinesAreWrittenOnlyForChanges) {
  std::FILE* file = std::tmpfile();
  ProgressDisplay display(file);
  for (int i = 0; i < 50; ++i) display.Show(Update(0.5 + i * 0.001, 1));
  display.Show(Update(0.71, 1));
  std::rewind(file);
  std::string text(4096, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 3) << text;
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
}

// Titles, stages and warnings come from afar.
TEST(ProgressDisplayTest, ControlCharactersAreEscaped) {
  v1::WatchJobResponse update = Update(0.5, 1);
  update.mutable_running(0)->set_title(
      "refine\x1b[2J\n\xC2\x9B"
      "31m");
  update.mutable_running(0)->set_stage("\u202estage");
  EXPECT_THAT(ProgressDisplay::RenderLines(update, 120)[1], HasSubstr("refine\\x1b[2J\\n\\u009b31m 50%  \\u202estage"));
  EXPECT_THAT(ProgressDisplay::RenderLines(update, 120)[1], Not(HasSubstr("\x1b")));
  std::FILE* file = std::tmpfile();
  ProgressDisplay display(file);
  display.Show(update);
  display.Note("warning: \x1b[1A");
  std::rewind(file);
  std::string text(4096, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  EXPECT_EQ(text.find('\x1b'), std::string::npos) << text;
  EXPECT_THAT(text, HasSubstr("refine\\x1b[2J\\n"));
  EXPECT_THAT(text, HasSubstr("warning: \\x1b[1A\n"));
}

TEST(JobTextTest, NamesDurationsAndNumbers) {
  EXPECT_EQ(FullJobName("7"), "jobs/7");
  EXPECT_EQ(FullJobName("jobs/7"), "jobs/7");
  EXPECT_EQ(FormatDuration(0.4), "0 s");
  EXPECT_EQ(FormatDuration(59.4), "59 s");
  EXPECT_EQ(FormatDuration(200), "3 min 20 s");
  EXPECT_EQ(FormatDuration(7500), "2 h 5 min");
  EXPECT_EQ(FormatThousands(0), "0");
  EXPECT_EQ(FormatThousands(999), "999");
  EXPECT_EQ(FormatThousands(-1234567), "-1,234,567");
}

}  // namespace
}  // namespace tessera

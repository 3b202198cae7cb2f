#include "server/tesserad/notify.h"

#include <gtest/gtest.h>

#include "common/storage/files.h"
#include "tests/support/notify_socket.h"

namespace tessera {
namespace {

TEST(Notify, SendsReadyToTheSocketOfTheServiceManager) {
  const auto folder = TempFolder::Create("", "notify-");
  ASSERT_TRUE(folder.ok());
  NotifyReady();  // does nothing without a service manager
  const NotifySocket manager(folder->path());
  EXPECT_EQ(manager.Received(), "");
  NotifyReady();
  EXPECT_EQ(manager.Received(), "READY=1");
}

}  // namespace
}  // namespace tessera

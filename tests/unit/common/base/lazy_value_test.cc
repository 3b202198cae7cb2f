#include "common/base/lazy_value.h"

#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/interned_string.h"

namespace tessera {
namespace {

TEST(LazyValueTest, CopiesAreDeep) {
  LazyValue<std::vector<int>> list;
  EXPECT_TRUE(list->empty());
  list.Edit().push_back(1);
  LazyValue<std::vector<int>> copy = list;
  copy.Edit().push_back(2);
  EXPECT_EQ(*list, std::vector<int>{1});
  EXPECT_EQ(*copy, (std::vector<int>{1, 2}));
  list = copy;
  copy.Clear();
  EXPECT_EQ(*list, (std::vector<int>{1, 2}));
  EXPECT_TRUE(copy->empty());
  copy = std::vector<int>{3};
  EXPECT_EQ(*std::as_const(copy), std::vector<int>{3});
  list = std::move(copy);
  EXPECT_EQ(*list, std::vector<int>{3});
}

TEST(InternedStringTest, EqualStringsShareStorageAcrossThreads) {
  const InternedString a = "a kind of tasks that is said often", b = std::string("a kind of tasks that is said often");
  EXPECT_EQ(a, b);
  EXPECT_EQ(&a.str(), &b.str());
  EXPECT_EQ(a, "a kind of tasks that is said often");
  EXPECT_FALSE(a == "another");
  EXPECT_EQ(InternedString(), "");
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 2000; ++i) {
        const InternedString text = std::to_string(i % 50), copy = text;
        EXPECT_EQ(copy, std::to_string(i % 50));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace
}  // namespace tessera

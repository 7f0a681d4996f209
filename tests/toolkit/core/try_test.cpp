// Early returns with an Error, and lists of names.
#include "toolkit/core/try.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "toolkit/core/words.h"

namespace palpate {
namespace {

Result<std::unique_ptr<int>> made(int value) {
  if (value < 0) return Error{"below 0", "give more", "a.txt", 7};
  return std::make_unique<int>(value);
}

/// `steps` counts how far it came.
Result<std::string> all(int first, int second, int& steps) {
  PALPATE_TRY(made(first));
  ++steps;
  PALPATE_ASSIGN(const std::unique_ptr<int> held, made(second));
  ++steps;
  int again = 0;
  PALPATE_ASSIGN(again, Result<int>(*held));
  return std::to_string(again);
}

TEST(Try, LeavesWithTheWholeErrorAndElseGoesOn) {
  int steps = 0;
  EXPECT_EQ(*all(1, 2, steps), "2");
  EXPECT_EQ(steps, 2);
  for (const int bad : {1, 2}) {
    steps = 0;
    const Result<std::string> left = all(bad == 1 ? -1 : 1, bad == 2 ? -1 : 1, steps);
    ASSERT_FALSE(left);
    EXPECT_EQ(steps, bad - 1);
    EXPECT_EQ(left.error().message(), "a.txt:7: below 0; give more");
  }
}

TEST(Words, ListsOfNames) {
  struct Thing {
    std::string name;
  };
  const std::vector<Thing> things = {{"a"}, {"b"}, {"c"}};
  EXPECT_EQ(joined(names_of(things)), "a, b, c");
  EXPECT_EQ(joined({"a", "b"}, " or "), "a or b");
  EXPECT_EQ(joined({}), "");
}

}  // namespace
}  // namespace palpate

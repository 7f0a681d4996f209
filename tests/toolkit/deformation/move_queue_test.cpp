// The queue that brings edits to renderers on other threads.
#include <palpate/motion.h>

#include <gtest/gtest.h>

#include <memory>
#include <thread>

namespace palpate::deformation {

using namespace render;

namespace {

TEST(MoveQueue, LosesNothingBetweenTwoThreads) {
  MoveQueue queue;
  const std::shared_ptr<MoveReader> readers[] = {queue.subscribe(), queue.subscribe()};
  constexpr std::uint32_t kBatches = 2000;
  std::thread writer([&] {
    for (std::uint32_t sent = 0; sent < kBatches;) {
      MoveBatch* batch = queue.begin();
      if (batch == nullptr) {
        std::this_thread::yield();  // the readers want the processor
        continue;
      }
      batch->count = 1;
      batch->point[0] = sent++;
      queue.publish();
    }
  });
  // Two renderers on one scene, each with all of the edits.
  const auto read = [](MoveReader& reader) {
    std::uint32_t expected = 0;
    bool in_order = true;
    while (expected < kBatches) {
      const MoveBatch* batch = reader.take();
      if (batch == nullptr) {
        std::this_thread::yield();
        continue;
      }
      in_order = in_order && batch->count == 1 && batch->point[0] == expected;
      ++expected;
    }
    return in_order;
  };
  bool in_order[2] = {};
  std::thread other([&] { in_order[1] = read(*readers[1]); });
  in_order[0] = read(*readers[0]);
  other.join();
  writer.join();
  EXPECT_TRUE(in_order[0]);
  EXPECT_TRUE(in_order[1]);
}

TEST(MoveQueue, AReaderThatIsGoneHoldsNobodyUp) {
  MoveQueue queue;
  std::shared_ptr<MoveReader> gone = queue.subscribe();
  const std::shared_ptr<MoveReader> stays = queue.subscribe();
  ASSERT_NE(queue.begin(), nullptr);
  queue.publish();
  ASSERT_NE(stays->take(), nullptr);
  EXPECT_EQ(queue.begin(), nullptr) << "one has still to take it";
  gone.reset();
  EXPECT_NE(queue.begin(), nullptr);
  // One that comes later gets what comes later.
  const std::shared_ptr<MoveReader> late = queue.subscribe();
  EXPECT_EQ(late->take(), nullptr);
  EXPECT_NE(queue.begin(), nullptr);
}

}  // namespace
}  // namespace palpate::deformation

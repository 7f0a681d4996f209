// What the tests of devices share: waiting on a busy machine, what a message says, drivers' refusals, a
// corpus.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/drivers.h>
#include <palpate/device/force_governor.h>
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"

namespace palpate::device {

using test::refused, test::value_of;

/// Waits until it is so; false after a patience that is no deadline: after it a test fails instead of
/// hanging.
template <class Condition>
[[nodiscard]] bool comes(const Condition& condition) {
  constexpr double kPatienceMs = 30'000.0;
  const Stopwatch watch;
  while (!condition()) {
    if (watch.ms() > kPatienceMs) return false;
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  }
  return true;
}

/// Options of a governor that a busy machine does not trip.
[[nodiscard]] inline GovernorOptions patient_governor(double soft_start_s = 0.05) {
  GovernorOptions options;
  options.soft_start_s = soft_start_s;
  options.late_zero_s = options.latch_late_s = options.silence_s = 30.0;
  return options;
}

/// Whether a text has these parts; a failure shows the text.
template <class... Parts>
[[nodiscard]] testing::AssertionResult says(std::string_view text, const Parts&... parts) {
  return test::contains(text, parts...);
}

/// Whether a Status or Result is none of an Error; a failure shows its message.
template <class Answer>
[[nodiscard]] testing::AssertionResult ok(const Answer& answer) {
  return answer ? testing::AssertionSuccess() : testing::AssertionFailure() << answer.error().message();
}

/// The driver of a device's name, which `add` registers.
[[nodiscard]] inline Driver driver_of(void (*add)(Drivers&), const std::string& name) {
  Drivers drivers;
  add(drivers);
  const Driver* driver = drivers.of(name);
  EXPECT_NE(driver, nullptr) << name;
  return driver == nullptr ? Driver{} : *driver;
}

/// The message with which a driver refuses a request; "made": it did not.
[[nodiscard]] inline std::string refusal_of(const Driver& driver, const DeviceRequest& request) {
  const MonotonicClock clock;
  const Result<MadeDevice> made = driver.make(request, clock);
  return made ? std::string("made") : made.error().message();
}

/// The contents of all files of a folder.
[[nodiscard]] inline std::vector<std::vector<std::uint8_t>> corpus_of(const std::string& folder) {
  std::vector<std::vector<std::uint8_t>> all;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::ifstream file(entry.path(), std::ios::binary);
    all.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return all;
}

/// Runs a fuzz target, which aborts where something is wrong, over a corpus of at least so many files.
inline void expect_corpus_passes(int (*target)(const std::uint8_t*, std::size_t), const std::string& folder,
                                 std::size_t least) {
  const auto corpus = corpus_of(folder);
  EXPECT_GE(corpus.size(), least);
  for (const auto& bytes : corpus) EXPECT_EQ(target(bytes.data(), bytes.size()), 0);
}

/// A stream of starts, packets and torn ones: plain noise holds none. `any` makes a packet.
template <class AnyPacket>
std::vector<std::uint8_t> torn_stream(Random& random, std::uint8_t start, const AnyPacket& any) {
  std::vector<std::uint8_t> stream;
  while (stream.size() < 100) {
    const auto bytes = encoded(any(random));
    const std::size_t from = random.below(3) == 0 ? random.below(bytes.size()) : 0;
    const std::size_t to = random.below(3) == 0 ? random.below(bytes.size() + 1) : bytes.size();
    for (std::size_t i = from; i < to; ++i) stream.push_back(bytes[i]);
    if (random.below(4) == 0) stream.push_back(start);
  }
  return stream;
}

/// A reader finds every packet between dirt without a start: a false start may swallow what follows it, as it
/// must.
template <class Reader, class AnyPacket>
void expect_found_in_dirt(std::uint8_t start, const AnyPacket& any) {
  Random random(11);
  for (int run = 0; run < 200; ++run) {
    Reader reader;
    std::vector<decltype(any(random))> sent, got;
    std::vector<std::uint8_t> stream;
    for (int i = 0; i < 20; ++i) {
      for (std::size_t k = random.below(20); k > 0; --k)
        stream.push_back(static_cast<std::uint8_t>(random.below(start)));
      sent.push_back(any(random));
      const auto bytes = encoded(sent.back());
      stream.insert(stream.end(), bytes.begin(), bytes.end());
    }
    for (const std::uint8_t byte : stream)
      if (const auto packet = reader.take(byte)) got.push_back(*packet);
    ASSERT_EQ(got, sent) << "seed 11, run " << run;
    ASSERT_EQ(reader.malformed(), 0u);
  }
}

}  // namespace palpate::device

#if defined(__SANITIZE_THREAD__) || defined(PALPATE_STD_THREADS)
#define PALPATE_SKIP_FORKS() GTEST_SKIP() << "ThreadSanitizer cannot be forked"
#else
#define PALPATE_SKIP_FORKS() static_cast<void>(0)
#endif

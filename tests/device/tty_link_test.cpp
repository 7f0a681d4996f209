// The serial link over a pseudo-terminal, and the hand-over of commands between threads.
#include "device/links/tty_link.h"

#include <cstring>

#include "device/arms/arm_device.h"
#include "device/haply/planar_device.h"
#include "device/interface/driver_options.h"
#include "device/links/newest_command.h"
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/planar_board.h"
#include "tests/device/tty_board.h"
#include "tests/house/allocation_count.h"

namespace palpate::device {
namespace {

std::vector<std::uint8_t> bytes_of(const std::string& text) {
  return {text.begin(), text.end()};
}
std::string text_of(const std::vector<std::uint8_t>& bytes) {
  return {bytes.begin(), bytes.end()};
}

TEST(NewestCommand, TheNewestIsTakenOnce) {
  NewestCommand newest;
  CommandBytes taken;
  EXPECT_TRUE(newest.empty());
  EXPECT_FALSE(newest.take(taken));
  EXPECT_FALSE(newest.put({}));
  EXPECT_FALSE(newest.put(std::vector<std::uint8_t>(CommandBytes::kMost + 1)));
  for (std::uint8_t i = 0; i < 100; ++i) EXPECT_TRUE(newest.put(std::vector<std::uint8_t>{i, i}));
  EXPECT_EQ(newest.replaced(), 99u);
  ASSERT_TRUE(newest.take(taken));
  EXPECT_EQ(taken.bytes[0], 99);
  EXPECT_EQ(taken.size, 2u);
  EXPECT_FALSE(newest.take(taken));
}

/// A writer and a number, written so often that a command made of two would show.
constexpr std::size_t kNumberedTimes = 5;
std::array<std::uint32_t, 2 * kNumberedTimes> numbered(std::uint32_t writer, std::uint32_t number) {
  std::array<std::uint32_t, 2 * kNumberedTimes> words{};
  for (std::size_t i = 0; i < words.size(); i += 2) words[i] = writer, words[i + 1] = number;
  return words;
}

// As a USB link uses it: the servo puts a command in every frame, the watchdog cuts meanwhile, the link's
// thread takes; what a thread has put is never taken after what it put later, and a zero at the end is the
// last.
TEST(NewestCommand, ServoWatchdogAndLinkAtOnceKeepItWholeAndInOrderAndEndInTheLastZero) {
  constexpr std::uint32_t kFrames = 30'000, kServo = 1, kCut = 2, kEnd = 3;
  NewestCommand newest;
  std::atomic<int> running{2};
  const auto put = [&](std::uint32_t writer, std::uint32_t number) {
    const auto words = numbered(writer, number);
    EXPECT_TRUE(newest.put({reinterpret_cast<const std::uint8_t*>(words.data()), sizeof words}));
  };
  const auto put_all = [&](std::uint32_t writer) {
    for (std::uint32_t i = 1; i <= kFrames; ++i) put(writer, i);
    --running;
  };
  std::thread servo([&] { put_all(kServo); }), watchdog([&] { put_all(kCut); });
  std::array<std::uint32_t, 4> last{};
  std::uint32_t writer = 0;
  std::uint64_t taken = 0;
  CommandBytes command;
  const auto take_all = [&] {
    while (newest.take(command)) {
      std::array<std::uint32_t, 2 * kNumberedTimes> words{};
      ASSERT_EQ(command.size, sizeof words);
      std::memcpy(words.data(), command.bytes.data(), sizeof words);
      ASSERT_EQ(words, numbered(words[0], words[1])) << "it is whole";
      writer = words[0];
      ASSERT_GT(words[1], last.at(writer)) << "of " << writer;
      last.at(writer) = words[1];
      ++taken;
    }
  };
  while (running.load() > 0) take_all();
  servo.join();
  watchdog.join();
  put(kEnd, 1);
  take_all();
  EXPECT_EQ(writer, kEnd) << "the zero of close() goes out last";
  EXPECT_TRUE(newest.empty());
  EXPECT_EQ(taken + newest.replaced(), 2u * kFrames + 1);
}

TEST(TtyLink, CarriesRawBytesBothWays) {
  TtyBoard board;
  TtyLink link({board.path()});
  std::array<std::uint8_t, 16> into{};
  EXPECT_FALSE(link.submit(bytes_of("x"))) << "closed";
  EXPECT_TRUE(link.poll(into).gone);
  ASSERT_TRUE(link.open());
  EXPECT_EQ(link.poll(into).size, 0u);
  // What a terminal in its usual mode would change: carriage returns, ends, Ctrl-C, Ctrl-S.
  const std::vector<std::uint8_t> odd = {0x0D, 0x0A, 0x03, 0x13, 0x11, 0x04, 0x00, 0xFF, 0x7F, 0x1A};
  EXPECT_TRUE(link.submit(odd));
  EXPECT_TRUE(comes([&] { return board.received() == odd; }));
  board.say(text_of(odd));
  std::vector<std::uint8_t> came;
  EXPECT_TRUE(comes([&] {
    const Polled polled = link.poll(into);
    came.insert(came.end(), into.begin(), into.begin() + static_cast<std::ptrdiff_t>(polled.size));
    return came.size() >= odd.size();
  }));
  EXPECT_EQ(came, odd);
  EXPECT_EQ(link.counters().written, 1u);
  EXPECT_GE(link.counters().received, 1u);
  link.close();
  link.close();
  EXPECT_FALSE(link.submit(odd));
}

TEST(TtyLink, SaysWhatIsNotRight) {
  const auto refused = [](const TtyLinkOptions& options) {
    TtyLink link(options);
    const auto opened = link.open();
    return opened ? std::string("opened") : opened.error().message();
  };
  EXPECT_TRUE(says(refused({"/dev/palpate-none-*"}), "there is no serial line"));
  EXPECT_TRUE(says(refused({"/dev/null"}), "no serial line"));
  EXPECT_TRUE(says(refused({"/dev/nul[l]", 12345}), "no rate"));
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "palpate_tty_test";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  TtyBoard one, two;
  std::filesystem::create_symlink(one.path(), folder / "usb-Board_1");
  std::filesystem::create_symlink(two.path(), folder / "usb-Board_2");
  const std::string both = (folder / "usb-Board_*").string();
  EXPECT_TRUE(says(refused({both}), "several serial lines fit"));
  EXPECT_TRUE(says(refused({both}), "usb-Board_2"));
  EXPECT_EQ(tty_lines(both).size(), 2u);
  EXPECT_TRUE(tty_lines(both).front().allowed);
  TtyLink link({(folder / "usb-*_2").string()});
  EXPECT_TRUE(link.open());
  EXPECT_EQ(link.path(), (folder / "usb-Board_2").string());
  std::filesystem::remove_all(folder);
}

TEST(TtyLink, AnUnpluggedBoardIsGone) {
  auto board = std::make_unique<TtyBoard>();
  TtyLink link({board->path()});
  ASSERT_TRUE(link.open());
  board.reset();
  std::array<std::uint8_t, 16> into{};
  EXPECT_TRUE(comes([&] { return link.poll(into).gone; }));
  EXPECT_FALSE(link.submit(bytes_of("x")));
  link.close();
}

TEST(TtyLink, AFullLineKeepsCommandsWholeAndTheNewestLast) {
  TtyBoard board;
  TtyLink link({board.path()});
  ASSERT_TRUE(link.open());
  board.stop_reading(true);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  // 1 MB: no terminal holds so much.
  const std::string filling(50, '.');
  int last = 0;
  for (; last < 20'000; ++last) {
    std::string text = std::to_string(last);
    text = "<" + std::string(8 - text.size(), '0') + text + filling + ">";
    ASSERT_TRUE(link.submit(bytes_of(text))) << "never blocks, never fails";
  }
  EXPECT_GT(link.counters().replaced, 1000u);
  board.stop_reading(false);
  std::array<std::uint8_t, 16> into{};
  const std::string end = "<00019999" + filling + ">";
  EXPECT_TRUE(comes([&] {
    (void)link.poll(into);  // finishes what was taken in part
    return text_of(board.received()).ends_with(end);
  }));
  const std::string all = text_of(board.received());
  ASSERT_EQ(all.size() % 60, 0u);
  int before = -1;
  for (std::size_t at = 0; at < all.size(); at += 60) {
    ASSERT_EQ(all[at], '<');
    ASSERT_EQ(all[at + 59], '>');
    const int number = std::stoi(all.substr(at + 1, 8));
    ASSERT_GT(number, before);
    before = number;
  }
}

TEST(TtyLink, ManyThreadsSubmitAndEveryLineIsWhole) {
  TtyBoard board;
  TtyLink link({board.path()});
  ASSERT_TRUE(link.open());
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 2000; ++i)
        link.submit(bytes_of("<" + std::string(30, static_cast<char>('a' + t)) + ">"));
    });
  std::array<std::uint8_t, 16> into{};
  for (int i = 0; i < 1000; ++i) (void)link.poll(into);
  for (std::thread& thread : threads) thread.join();
  ASSERT_TRUE(comes([&] {
    (void)link.poll(into);
    return board.received().size() == 32 * link.counters().written && link.counters().written > 0;
  }));
  const std::string all = text_of(board.received());
  for (std::size_t at = 0; at < all.size(); at += 32) {
    ASSERT_EQ(all[at], '<');
    ASSERT_EQ(all.substr(at + 1, 30), std::string(30, all[at + 1]));
    ASSERT_EQ(all[at + 31], '>');
  }
  EXPECT_EQ(link.counters().written + link.counters().replaced, 6000u);
}

TEST(TtyLink, ClosingWhileOthersSubmitIsSound) {
  TtyBoard board;
  for (int round = 0; round < 20; ++round) {
    TtyLink link({board.path()});
    ASSERT_TRUE(link.open());
    std::atomic<bool> ending{false};
    std::thread watchdog([&] {
      while (!ending) link.submit(bytes_of("[0,0,0]        \n"));
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    link.close();
    ending = true;
    watchdog.join();
    EXPECT_FALSE(link.submit(bytes_of("x")));
  }
}

/// Answers each line with one of its own, as Polhem's board does.
class TextBoard {
 public:
  TtyBoard::Answer answer() {
    return [this, held = std::string()](std::span<const std::uint8_t> bytes) mutable {
      std::string reply;
      for (const std::uint8_t byte : bytes) {
        held.push_back(static_cast<char>(byte));
        if (byte != '\n') continue;
        const std::lock_guard lock(mutex_);
        last_ = std::exchange(held, {});
        reply += "[1," + std::to_string(lines++ % 50) + ",0,0,0,0,0,0]\n";
      }
      return TtyBoard::Bytes(reply.begin(), reply.end());
    };
  }
  std::string last() {
    const std::lock_guard lock(mutex_);
    return last_;
  }
  std::atomic<int> lines{0};

 private:
  std::mutex mutex_;
  std::string last_;
};

const std::string kTextZero = "[0,0,0]        \n";

TEST(TtyLink, AnArmSpeaksTextOverIt) {
  TextBoard text;
  auto board = std::make_unique<TtyBoard>(text.answer());
  ArmDescription arm = find_arm("polhem-v3").value();
  arm.serial_line = board->path();
  const MonotonicClock clock;
  ArmDevice device(arm, arm_link(arm), clock);
  ASSERT_TRUE(ok(device.open()));
  int fresh = 0;
  ASSERT_TRUE(comes([&] {
    const DeviceState state = device.read();
    fresh += state.status == ReadStatus::kFresh ? 1 : 0;
    device.send(governed(Vec3(0, 0, 0.5)));
    return fresh >= 200;
  }));
  EXPECT_EQ(device.counters().malformed, 0u);
  EXPECT_TRUE(comes([&] { return text.last() != kTextZero; }));
  EXPECT_TRUE(device.cut_force());
  device.close();
  EXPECT_TRUE(comes([&] { return text.last() == kTextZero; })) << "zero is the last that it hears";
  // The guard's way, with a handle of its own.
  const auto made = value_of(
      driver_of(&register_arm_driver, "arm").make({"arm:polhem-v3", {}, {{"path", board->path()}}}, clock));
  std::this_thread::sleep_for(std::chrono::milliseconds(50));  // what was under way
  const int before = text.lines;
  EXPECT_TRUE(made.zero());
  ASSERT_TRUE(made.facts);
  const DeviceFacts facts = made.facts();
  for (const auto& fact : DeviceFacts{{"arm", "polhem-v3"},
                                      {"counts_per_turn", "4096 4096 4096"},
                                      {"rest", "power-on"},
                                      {"reports", "0"}})
    EXPECT_NE(std::find(facts.begin(), facts.end(), fact), facts.end()) << fact.first;
  EXPECT_TRUE(comes([&] { return text.lines > before; }));
  // Unplugged in a session, and plugged in again.
  ASSERT_TRUE(device.open());
  board.reset();
  EXPECT_TRUE(comes([&] { return device.read().status == ReadStatus::kLost; }));
  EXPECT_FALSE(device.cut_force());
  device.close();
}

TEST(TtyLink, FramesOfAnArmAllocateNothing) {
  TextBoard text;
  TtyBoard board(text.answer());
  ArmDescription arm = find_arm("polhem-v3").value();
  arm.serial_line = board.path();
  const MonotonicClock clock;
  ArmDevice device(arm, arm_link(arm), clock);
  ASSERT_TRUE(device.open());
  ForceGovernor governor = ForceGovernor::create(device.limits(), {}).value();
  governor.arm(clock.now_s());
  int fresh = 0;
  std::uint64_t allocated = 0;
  {
    const house::AllocationCount count(house::AllocationCount::Threads::kThisOne);
    for (int i = 0; i < 2'000'000 && fresh < 300; ++i) {
      const DeviceState state = device.read();
      fresh += state.status == ReadStatus::kFresh ? 1 : 0;
      device.send(governor.govern(clock.now_s(), state, Vec3(0, 0, 0.5)));
      if (i % 100 == 0) device.cut_force();
    }
    allocated = count.count();
  }
  EXPECT_GE(fresh, 300);
  EXPECT_EQ(allocated, 0u);
}

// planar_test.cpp goes through every part of a command; here it is the line that is new.
TEST(TtyLink, APlaneLetsGoOfWhatAPartOfACommandLeft) {
  const CommandBytes held = encoded_torques({0.1F, -0.1F});
  for (const std::size_t sent : {std::size_t{1}, held.size / 2, held.size - 1}) {
    std::mutex mutex;
    PlanarBoard plane;
    TtyBoard board([&](std::span<const std::uint8_t> bytes) {
      const std::lock_guard lock(mutex);
      return plane.take(bytes);
    });
    const MonotonicClock clock;
    const auto made = value_of(
        driver_of(&register_planar_driver, "planar").make({"planar", {}, {{"path", board.path()}}}, clock));
    const int line = ::open(board.path().c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
    ASSERT_EQ(::write(line, held.bytes.data(), held.size), static_cast<ssize_t>(held.size));
    ASSERT_EQ(::write(line, held.bytes.data(), sent), static_cast<ssize_t>(sent));
    const auto torques = [&] {
      const std::lock_guard lock(mutex);
      return plane.torques;
    };
    ASSERT_TRUE(comes([&] { return torques() == std::array<float, 2>{-0.1F, 0.1F}; }));
    EXPECT_TRUE(comes([&] { return made.zero(); })) << "as a guard does, until the board has answered";
    const DeviceFacts facts = made.facts();
    EXPECT_EQ(facts.front(), (std::pair<std::string, std::string>{"model", "2DIY, generation 2"}));
    ::close(line);
    EXPECT_TRUE(comes([&] { return torques() == std::array<float, 2>{}; })) << sent;
    const std::lock_guard lock(mutex);
    EXPECT_LE(plane.most, 0.1F);
  }
}

TEST(TtyLink, APlaneThatAnswersNothingIsNotSaidToHaveLetGo) {
  TtyBoard board;
  TtyLink link({board.path()});
  ASSERT_TRUE(link.open());
  EXPECT_FALSE(release_plane(link));
  link.close();
  ASSERT_TRUE(comes([&] { return board.received().size() >= encoded_release().size; })) << "but it was told";
}

}  // namespace
}  // namespace palpate::device

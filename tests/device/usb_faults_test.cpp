// What goes wrong between a servo and a Falcon, over the real libusb. See docs/results/hands-and-loops.md for
// the table.
#include <fmt/format.h>
#include <time.h>

#include <palpate/clock.h>
#include "device/falcon/falcon_packets.h"
#include "device/links/usb_link.h"
#include "tests/device/helpers.h"
#include "tests/device/link_benches.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/usbfs_double.h"

namespace palpate::device {
namespace {

constexpr const char* kUsbFaultsName = "libusb, Falcon";
// As where round trips are measured: above the servo's 80, which waits for them, below the link's 83.
constexpr int kPretendingPriority = 82;

constexpr timespec kTransferTime{0, 1'000'000};  // the link's thread hands over what it may in far less
// What is with the kernel cannot be called back: so that is one transfer of a force. What waits is replaced,
// and a zero does not wait.
TEST(UsbLink, AZeroHasOneTransferBeforeItAtMost) {
  FalconBoard board;
  board.run_firmware();
  UsbfsDouble usb(board);
  UsbLink link({0x0403, 0xCB48, ""}, {}, "falcon", falcon_lets_go, 0);
  ASSERT_TRUE(link.open());
  ASSERT_TRUE(link.control({0x40, 0x03, 0x0002, 0}));
  std::vector<int> taken;  // by the board, in its order
  usb.with([&](FalconBoard& now) {
    now.commanded = [&taken](const FalconBoard& taker) { taken.push_back(taker.held().motors[0]); };
  });
  const auto force = [&](int counts) { return link.submit(encoded(FalconCommand{{counts, 0, 0}, 1})); };
  const auto commands = [&] {
    std::uint64_t count = 0;
    usb.with([&](FalconBoard& now) { count = now.commands(); });
    return count;
  };
  usb.hold_out(true);
  ASSERT_TRUE(force(100));
  ASSERT_TRUE(comes([&] { return usb.out_under_way() == 1; }));
  constexpr int kForces = 20;
  for (int i = 1; i <= kForces; ++i) {
    ASSERT_TRUE(force(100 + i));
    ::nanosleep(&kTransferTime, nullptr);  // the link's thread has time to hand over what it may
    ASSERT_EQ(usb.out_under_way(), 1) << i;
  }
  ASSERT_TRUE(link.submit(falcon_zero()));
  ASSERT_TRUE(comes([&] { return usb.out_under_way() == 2; })) << "though nothing has moved";
  for (const int counts : {0, 7, 0, 8}) {
    ASSERT_TRUE(force(counts));
    ::nanosleep(&kTransferTime, nullptr);
    ASSERT_EQ(usb.out_under_way(), 2) << counts;
  }
  usb.hold_out(false);
  ASSERT_TRUE(comes([&] { return commands() >= 3; }));
  link.close();
  usb.with([](FalconBoard& now) { now.commanded = {}; });
  EXPECT_EQ(taken, (std::vector<int>{100, 0, 8})) << "what was under way, the zero, and then the newest";
  const UsbLinkCounters counters = link.counters();
  EXPECT_EQ(counters.sent + counters.overtaken, 1u + kForces + 1 + 4) << "each is counted";
}

class UsbLinkFaults : public testing::TestWithParam<int> {};

TEST_P(UsbLinkFaults, EndInZero) {
  FalconBench<UsbfsDouble> bench(kUsbFaultsName, 0, 0);
  EXPECT_EQ(violations_of(bench, static_cast<LinkWrong>(GetParam())), "");
}
INSTANTIATE_TEST_SUITE_P(Each, UsbLinkFaults, testing::Range(0, kLinkWrongs));

}  // namespace

bool measure_usb_faults(int runs, std::string& rows_json) {
  // Real-time priorities on both sides, where they are allowed: what is late is then not other programs'
  // work.
  FalconBench<UsbfsDouble> bench(kUsbFaultsName, UsbLink::kPriority, kPretendingPriority);
  const bool right = measure_link_faults(bench, runs, rows_json);
  const UsbLinkCounters counted = bench.link_counters();
  fmt::print(stderr, "{} commands, {} overtaken; with the kernel for {:.0f} us each, {:.0f} at most\n",
             counted.sent, counted.overtaken, counted.out_mean_us, counted.out_most_us);
  return right;
}

}  // namespace palpate::device

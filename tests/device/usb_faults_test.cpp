// What goes wrong between a servo and a Falcon, over the real libusb. See docs/safety.md for the table.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "device/links/usb_link.h"
#include "tests/device/link_benches.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/usbfs_double.h"
#include "tests/device/usb_faults.h"

namespace palpate::device {
namespace {

constexpr const char* kUsbFaultsName = "libusb, Falcon";
// As where round trips are measured: above the servo's 80, which waits for them, below the link's 83.
constexpr int kPretendingPriority = 82;

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

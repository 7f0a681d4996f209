// What goes wrong between a servo and a device over libusb, hidapi and a kernel that knows the devices: below
// its USB core a virtual controller (vhci-hcd), below its HID core uhid. Where the kernel has neither, which
// tests/nightly/run mends with a virtual machine, it is skipped. See docs/tutorials/your-device.md.
//
//   test_kernel --faults RUNS FILE.json     the rows of docs/results/hands-and-loops.md, in real time
#include <fmt/format.h>

#include <cstdio>

#include "device/links/usb_link.h"
#include "tests/device/helpers.h"
#include "tests/device/link_benches.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/hidraw_double.h"
#include "tests/device/mock/usbfs_double.h"

namespace palpate::device {
namespace {

constexpr const char* kKernelUsb = "libusb, kernel, Falcon";
constexpr const char* kKernelHid = "hidapi, kernel, arm with reports";
constexpr int kKernelPretending = 82;  // as over umockdev

class KernelLinkFaults : public testing::TestWithParam<int> {
 protected:
  static LinkWrong wrong() { return static_cast<LinkWrong>(GetParam()); }
};

TEST_P(KernelLinkFaults, OverUsbEndInZero) {
  FalconBench<VhciDouble> bench(kKernelUsb, 0, 0);
  EXPECT_EQ(violations_of(bench, wrong()), "");
}
TEST_P(KernelLinkFaults, OverHidEndInZero) {
  HidBench<UhidDouble> bench(kKernelHid);
  EXPECT_EQ(violations_of(bench, wrong()), "");
}
INSTANTIATE_TEST_SUITE_P(Each, KernelLinkFaults, testing::Range(0, kLinkWrongs));

TEST(KernelFalcon, LoadsFirmware) {
  FalconBoard board;
  VhciDouble usb(board);
  const MonotonicClock clock;
  FalconOptions options;
  const std::vector<std::uint8_t> image = made_up_image(2, 150);
  options.firmware = [&] { return check_falcon_firmware(image); };
  FalconDevice device(
      std::make_unique<UsbLink>(UsbAddress{0x0403, 0xCB48, ""}, UsbInterface{}, "falcon", falcon_lets_go, 0),
      clock, options);
  ASSERT_TRUE(ok(device.open()));
  EXPECT_FALSE(device.booted().was_running);
  usb.with([&](FalconBoard& now) { EXPECT_EQ(now.loaded(), image); });
}

bool measure_kernel_faults(int runs, std::string& rows_json) {
  bool right = true;
  {
    FalconBench<VhciDouble> bench(kKernelUsb, UsbLink::kPriority, kKernelPretending);
    right = measure_link_faults(bench, runs, rows_json);
  }
  HidBench<UhidDouble> bench(kKernelHid);
  return measure_link_faults(bench, runs, rows_json) && right;
}

}  // namespace
}  // namespace palpate::device

int main(int argc, char** argv) {
  using namespace palpate::device;
  const std::string first = argc > 1 ? argv[1] : "";
  if (first == kPressArgument) press_until_killed(std::vector<std::string>(argv + 2, argv + argc));
  for (const std::string& missing : {VhciDouble::missing(), UhidDouble::missing()}) {
    if (missing.empty()) continue;
    fmt::print(stderr, "skipped: {}\n", missing);
    constexpr int kSkipped = 77;  // what CTest takes for a skipped test
    return kSkipped;
  }
  if (first == "--faults") return measured_faults(argc, argv, measure_kernel_faults);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}

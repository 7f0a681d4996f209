// What goes wrong between a servo and a Falcon, over the real libusb. See docs/safety.md for the table.
#include <gtest/gtest.h>

#include <cmath>

#include "device/falcon/falcon_device.h"
#include "device/links/usb_link.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/usbfs_double.h"
#include "tests/device/usb_faults.h"
#include "toolkit/core/clock.h"

namespace palpate::device {
namespace {

// As where round trips are measured: below the watchdog's 85, above the servo's 80, which waits for them.
constexpr int kPretendingPriority = 82;

class FalconBench final : public LinkBench {
 public:
  /// `real_time`: the link's thread with its own priority, and those that pretend with one, where that is
  /// allowed: what is then late is not the machine's other work.
  explicit FalconBench(bool real_time) : link_priority_(real_time ? UsbLink::kPriority : 0) {
    board_.run_firmware();
    const Vec3 counts = falcon_counts_of_angles(falcon_angles(Vec3{0.0, 0.0, kFalconCentreMm}).value());
    board_.home({static_cast<int>(std::lround(counts[0])), static_cast<int>(std::lround(counts[1])),
                 static_cast<int>(std::lround(counts[2]))});
    board_.instead = [this](std::vector<std::uint8_t> reply) { return replies.instead_of(std::move(reply)); };
    board_.commanded = [this](const FalconBoard& now) { held.tell(now.holds_force()); };
    usb_ = std::make_unique<UsbfsDouble>(board_);
    if (real_time) usb_->run_at(kPretendingPriority);
  }
  std::string link() const override { return "libusb, Falcon"; }
  Device& device() override { return device_; }
  // Without its cable it is taken to be without power.
  void unplug() override {
    usb_->unplug();
    usb_->with([&](FalconBoard&) { held.tell(false); });
  }
  void plug() override { usb_->plug(); }
  bool counts_packets() const override { return false; }
  std::vector<std::string> program() const override { return {"falcon"}; }

 private:
  int link_priority_;
  FalconBoard board_;
  std::unique_ptr<UsbfsDouble> usb_;
  MonotonicClock clock_;
  FalconDevice device_{
      std::make_unique<UsbLink>(UsbAddress{0x0403, 0xCB48, ""}, UsbInterface{}, "falcon", link_priority_),
      clock_,
      {}};
};

class UsbLinkFaults : public testing::TestWithParam<int> {};

TEST_P(UsbLinkFaults, EndInZero) {
  FalconBench bench(false);
  EXPECT_EQ(violations_of(bench, static_cast<LinkWrong>(GetParam())), "");
}
INSTANTIATE_TEST_SUITE_P(Each, UsbLinkFaults, testing::Range(0, kLinkWrongs));

}  // namespace

bool measure_usb_faults(int runs, std::string& rows_json) {
  FalconBench bench(true);
  return measure_link_faults(bench, runs, rows_json);
}

}  // namespace palpate::device

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

class FalconBench final : public LinkBench {
 public:
  FalconBench() {
    board_.run_firmware();
    const Vec3 counts = falcon_counts_of_angles(falcon_angles(Vec3{0.0, 0.0, kFalconCentreMm}).value());
    board_.home({static_cast<int>(std::lround(counts[0])), static_cast<int>(std::lround(counts[1])),
                 static_cast<int>(std::lround(counts[2]))});
    board_.instead = [this](std::vector<std::uint8_t> reply) { return replies.instead_of(std::move(reply)); };
    usb_ = std::make_unique<UsbfsDouble>(board_);
  }
  std::string link() const override { return "libusb, Falcon"; }
  Device& device() override { return device_; }
  bool holds_force() override {
    bool holds = false;
    usb_->with([&](FalconBoard& now) { holds = plugged_ && now.holds_force(); });
    return holds;
  }
  void unplug() override {
    usb_->unplug();
    usb_->with([&](FalconBoard&) { plugged_ = false; });
  }
  void plug() override {
    usb_->plug();
    usb_->with([&](FalconBoard&) { plugged_ = true; });
  }
  bool counts_packets() const override { return false; }
  std::vector<std::string> program() const override { return {"falcon"}; }

 private:
  FalconBoard board_;
  bool plugged_ = true;  // the board's, under its lock; without its cable it is taken to be without power
  std::unique_ptr<UsbfsDouble> usb_;
  MonotonicClock clock_;
  FalconDevice device_{
      std::make_unique<UsbLink>(UsbAddress{0x0403, 0xCB48, ""}, UsbInterface{}, "falcon", 0), clock_, {}};
};

class UsbLinkFaults : public testing::TestWithParam<int> {};

TEST_P(UsbLinkFaults, EndInZero) {
  FalconBench bench;
  EXPECT_EQ(violations_of(bench, static_cast<LinkWrong>(GetParam())), "");
}
INSTANTIATE_TEST_SUITE_P(Each, UsbLinkFaults, testing::Range(0, kLinkWrongs));

}  // namespace

bool measure_usb_faults(int runs, std::string& rows_json) {
  FalconBench bench;
  return measure_link_faults(bench, runs, rows_json);
}

}  // namespace palpate::device

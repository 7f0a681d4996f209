// The benches of link_faults.h for a Falcon and for an arm with reports, over whatever pretends the cable:
// umockdev below the libraries, or a kernel's own virtual controllers.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include "device/arms/arm_device.h"
#include "device/falcon/falcon_device.h"
#include "device/links/usb_link.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/falcon_board.h"

namespace palpate::device {

inline constexpr std::chrono::milliseconds kBoardPeriod{1};

/// A thread that does something again and again until this ends.
class Repeating {
 public:
  template <class Do>
  explicit Repeating(Do act)
      : thread_([this, act = std::move(act)] {
          while (!over_.load()) act();
        }) {}
  ~Repeating() {
    over_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> over_{false};
  std::thread thread_;
};

/// A Falcon in the middle of its workspace. `Cable` as UsbfsDouble.
template <class Cable>
class FalconBench final : public LinkBench {
 public:
  /// `link_priority`: of the link's thread, 0: as others have it. `pretending`: of those that pretend.
  FalconBench(std::string name, int link_priority, int pretending)
      : name_(std::move(name)), device_(made_link(link_priority), clock_, {}) {
    board_.run_firmware();
    board_.home(falcon_counts_at(Vec3::Zero()));
    board_.instead = [this](std::vector<std::uint8_t> reply) { return replies.instead_of(std::move(reply)); };
    board_.commanded = [this](const FalconBoard& now) { held.tell(now.holds_force()); };
    cable_ = std::make_unique<Cable>(board_);
    if (pretending > 0) cable_->run_at(pretending);
  }
  std::string link() const override { return name_; }
  Device& device() override { return device_; }
  // Without its cable it is taken to be without power.
  void unplug() override {
    cable_->unplug();
    cable_->with([&](FalconBoard&) { held.tell(false); });
  }
  void plug() override { cable_->plug(); }
  bool counts_packets() const override { return false; }
  std::vector<std::string> program() const override { return {"falcon"}; }
  [[nodiscard]] UsbLinkCounters link_counters() const { return link_->counters(); }

 private:
  std::unique_ptr<UsbLink> made_link(int priority) {
    auto made = std::make_unique<UsbLink>(UsbAddress{0x0403, 0xCB48, ""}, UsbInterface{}, "falcon",
                                          falcon_lets_go, priority);
    link_ = made.get();
    return made;
  }

  std::string name_;
  UsbLink* link_ = nullptr;  // the device's
  FalconBoard board_;
  std::unique_ptr<Cable> cable_;
  MonotonicClock clock_;
  FalconDevice device_;
};

/// WoodenHaptics' board: sends unasked, each report with a count; lies still. `Cable` as HidrawDouble.
template <class Cable>
class HidBench final : public LinkBench {
 public:
  explicit HidBench(std::string name) : name_(std::move(name)) {}
  std::string link() const override { return name_; }
  Device& device() override { return device_; }
  void unplug() override {
    plugged_ = false;
    cable_.unplug();
    held.tell(false);
  }
  void plug() override {
    if (!plugged_) cable_.plug();  // twice would be two of them
    plugged_ = true;
  }
  bool counts_packets() const override { return true; }
  std::vector<std::string> program() const override { return {"arm:woodenhaptics"}; }

 private:
  using Bytes = std::vector<std::uint8_t>;
  std::optional<Bytes> take(std::span<const std::uint8_t> bytes) {
    constexpr std::size_t kFrom = 1, kCurrentBytes = 6;  // behind the 0 that stands for no number
    const auto currents = bytes.subspan(std::min(kFrom, bytes.size()));
    held.tell(
        plugged_ && currents.size() >= kCurrentBytes &&
        std::ranges::any_of(currents.first(kCurrentBytes), [](std::uint8_t byte) { return byte != 0; }));
    return std::nullopt;
  }
  void report_one() {
    std::this_thread::sleep_for(kBoardPeriod);
    if (!plugged_) return;
    count_ = (count_ + 1) % 30'000;
    for (const Bytes& one : replies.instead_of(words({0, 0, 0, count_}))) cable_.report(one);
  }

  std::string name_;
  std::atomic<bool> plugged_{true};
  int count_ = 0;
  Cable cable_{{}, [this](std::span<const std::uint8_t> bytes) { return take(bytes); }};
  MonotonicClock clock_;
  ArmDescription arm_ = find_arm("woodenhaptics").value();
  ArmDevice device_{arm_, arm_link(arm_), clock_};
  Repeating sender_{[this] { report_one(); }};
};

}  // namespace palpate::device

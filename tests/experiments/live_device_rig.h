// A driver for tests of sessions: packets over a simulated link, to a board that holds its last force, as
// real ones may; its board stands in a file, so that another process can look at it.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/device/drivers.h>
#include "device/simulated/packet_device.h"
#include "device/simulated/simulated_arm.h"
#include "device/simulated/simulated_link.h"
#include "experiments/live/live.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {

/// A board that processes share by a file.
class FileBoard {
 public:
  FileBoard(const std::string& file, bool fresh) {
    const int fd = ::open(file.c_str(), O_RDWR | O_CREAT, 0600);
    EXPECT_GE(fd, 0);
    EXPECT_EQ(::ftruncate(fd, sizeof(device::SimulatedBoard)), 0);
    void* at = ::mmap(nullptr, sizeof(device::SimulatedBoard), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    ::close(fd);
    EXPECT_NE(at, MAP_FAILED);
    board_ = fresh ? new (at) device::SimulatedBoard : static_cast<device::SimulatedBoard*>(at);
  }
  FileBoard(const FileBoard&) = delete;
  FileBoard& operator=(const FileBoard&) = delete;
  ~FileBoard() { ::munmap(board_, sizeof(device::SimulatedBoard)); }
  [[nodiscard]] device::SimulatedBoard& board() const { return *board_; }

 private:
  device::SimulatedBoard* board_ = nullptr;
};

/// What the test sees of the device, and what is to go wrong.
struct PacketsPlan {
  explicit PacketsPlan(const std::string& file, bool fresh = true) : shared(file, fresh) {}
  [[nodiscard]] device::SimulatedBoard& board() const { return shared.board(); }

  FileBoard shared;
  std::string transport = "usb";
  std::vector<device::LinkFault> faults{};  ///< since each opening
  int fails_before_back = 0;                ///< of openings, until it is plugged in again
  bool opens = true;
  bool guarded = true;
  bool has_motors = true;
  std::atomic<int> opened{0}, not_opened{0}, rounds_with_force{0};
};

/// Presses onto the scene's middle from 5 mm above, half a second after each opening.
class PacketsDevice final : public device::Device {
 public:
  PacketsDevice(PacketsPlan& plan, const Clock& clock)
      : plan_(plan),
        script_(device::HandScript::create("press", {0.0, 0.5}, {Vec3{0.0, 0.0, 5.0}, Vec3{0.0, 0.0, -1.5}},
                                           device::HandScript::Between::kMinimumJerk)
                    .value()),
        link_(plan.board(), script_, clock, {}, plan.faults),
        inner_(link_, clock) {}
  ~PacketsDevice() override { PacketsDevice::close(); }

  std::string name() const override { return "test:packets"; }
  Status open() override {
    if (!plan_.opens) return Error{"there is no such device", "plug it in", name()};
    if (!plan_.board().plugged() && ++fails_ > plan_.fails_before_back) {
      plan_.board().plug();
      fails_ = 0;
    }
    const Status opened = inner_.open();
    opened ? ++plan_.opened : ++plan_.not_opened;
    forced_ = false;
    return opened;
  }
  void close() noexcept override { inner_.close(); }
  device::DeviceLimits limits() const noexcept override { return inner_.limits(); }
  device::DeviceState read() noexcept override { return inner_.read(); }
  void send(device::GovernedForce force) noexcept override {
    inner_.send(std::move(force));
    if (!forced_ && plan_.board().holds_force()) {
      forced_ = true;
      ++plan_.rounds_with_force;
    }
  }
  bool cut_force() noexcept override { return inner_.cut_force(); }

 private:
  PacketsPlan& plan_;
  device::HandScript script_;
  device::SimulatedLink link_;
  device::PacketDevice inner_;
  int fails_ = 0;
  bool forced_ = false;
};

/// The simulated drivers, and "packets". The plan is referred to.
inline device::Drivers drivers_with(PacketsPlan& plan) {
  device::Drivers drivers;
  device::register_simulated_drivers(drivers);
  drivers.add(
      {"packets", plan.transport,
       [] {
         return std::vector<device::DeviceEntry>{
             {"packets", "a board for tests", device::DeviceStatus::kReady, {}}};
       },
       [&plan](const device::DeviceRequest& request, const Clock& clock) -> Result<device::MadeDevice> {
         for (const auto& [key, value] : request.options)
           if (key != "force_n") return Error{"packets has no option '" + key + "'", "it takes force_n"};
         device::MadeDevice made;
         made.device = std::make_unique<PacketsDevice>(plan, clock);
         if (plan.guarded)
           made.zero = [&plan] {
             plan.board().command(device::PacketDevice::zero_command(), monotonic_ns());
             return true;
           };
         made.has_motors = plan.has_motors;
         made.unproven = {"that its motors let go when its cable is pulled"};
         made.facts = [&plan] {
           return std::vector<std::pair<std::string, std::string>>{{"filter", "none of its own"},
                                                                   {"openings", std::to_string(plan.opened)}};
         };
         return made;
       }});
  return drivers;
}

/// A session of one renderer on a small sinusoid.
inline LiveArguments session_of(const std::string& device, const std::string& out, double seconds) {
  LiveArguments a;
  a.run.scene = kSmallWaves;
  a.run.renderers = "cloud";
  a.run.out = out;
  a.run.json = true;
  a.run.load.threads = 1;
  a.device.device = device;
  a.seconds = seconds;
  return a;
}

}  // namespace palpate::experiments

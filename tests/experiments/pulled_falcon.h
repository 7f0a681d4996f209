// A Falcon for tests that has to find its zero first.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>

#include <palpate/device/drivers.h>
#include "device/falcon/falcon_device.h"
#include "tests/device/mock/falcon_link.h"

namespace palpate::experiments {

/// A Falcon whose grip is pulled out slowly: a leg knows its zero after so many commands each, counted from
/// when `pulled` is true; null: from the first.
class PulledFalcon final : public device::ControlLink {
 public:
  PulledFalcon(const Clock& clock, int commands_per_leg, const std::atomic<bool>* pulled = nullptr)
      : link_(board_, clock), per_leg_(commands_per_leg), pulled_(pulled) {
    board_.run_firmware();
  }
  Status open() override { return link_.open(); }
  void close() noexcept override { link_.close(); }
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    if (pulled_ == nullptr || pulled_->load(std::memory_order_acquire)) ++commands_;
    const int legs = std::min(commands_ / per_leg_, 3);
    board_.homed = static_cast<std::uint8_t>((1 << legs) - 1);
    return link_.submit(bytes);
  }
  device::Polled poll(std::span<std::uint8_t> into) noexcept override { return link_.poll(into); }
  Status control(const device::ControlRequest& request) override { return link_.control(request); }

 private:
  device::FalconBoard board_;
  device::FalconLink link_;
  int per_leg_, commands_ = 0;
  const std::atomic<bool>* pulled_;
};

/// As its driver makes it.
inline device::MadeDevice pulled_falcon(const Clock& clock, int commands_per_leg,
                                        const std::atomic<bool>* pulled = nullptr) {
  device::FalconOptions options;
  options.pause = [](int) {};
  device::MadeDevice made;
  made.device = std::make_unique<device::FalconDevice>(
      std::make_unique<PulledFalcon>(clock, commands_per_leg, pulled), clock, options);
  made.homing_prompt = device::falcon_homing_prompt;
  return made;
}

}  // namespace palpate::experiments

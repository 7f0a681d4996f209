#include "device/servo/reconnecting_device.h"

#include <time.h>

#include <utility>

#include <palpate/result.h>

namespace palpate::device {
namespace {

// cut_force never blocks; waiting for it takes a few instructions, or an interrupted thread's time.
constexpr timespec kCutUnderWay{0, 50'000};

bool same_limits(const DeviceLimits& a, const DeviceLimits& b) noexcept {
  return a.force_max_n == b.force_max_n && a.workspace_mm.low_mm == b.workspace_mm.low_mm &&
         a.workspace_mm.high_mm == b.workspace_mm.high_mm && a.resolution_mm == b.resolution_mm &&
         a.rate_hz == b.rate_hz && a.stiffness_max_n_per_mm == b.stiffness_max_n_per_mm &&
         a.damping_max_n_s_per_mm == b.damping_max_n_s_per_mm && a.workspace_shape == b.workspace_shape;
}

}  // namespace

Status ReconnectingDevice::open() {
  if (here() && unread_) return Done{};
  close();
  PALPATE_TRY(inner_.open());
  limits_ = inner_.limits();
  unread_ = true;
  gone_ = false;
  ended_.store(false);
  owner_.store(Owner::kServo);
  return Done{};
}

/// Closes it if owned by `from`; of two callers one does.
void ReconnectingDevice::close_from(Owner from) noexcept {
  if (!owner_.compare_exchange_strong(from, Owner::kOther)) return;
  inner_.close();
  owner_.store(Owner::kNobody);
}

void ReconnectingDevice::close() noexcept {
  ended_.store(true);
  close_from(Owner::kServo);
  close_from(Owner::kLost);
}

DeviceState ReconnectingDevice::read() noexcept {
  DeviceState state;
  state.status = ReadStatus::kLost;
  if (!here()) return state;
  unread_ = false;
  state = inner_.read();
  gone_ = state.status == ReadStatus::kLost;
  homing_.store(state.homed ? kHomed : state.homing_step, std::memory_order_release);
  return state;
}

// The tick that loses the device still sends: zero, because the governor saw the state.
void ReconnectingDevice::send(GovernedForce force) noexcept {
  if (!here()) return;
  inner_.send(std::move(force));
  if (std::exchange(gone_, false)) owner_.store(Owner::kLost);
}

bool ReconnectingDevice::cut_force() noexcept {
  cutting_.fetch_add(1);
  const bool cut = owner_.load() != Owner::kOther && inner_.cut_force();
  cutting_.fetch_sub(1);
  return cut;
}

Status ReconnectingDevice::reopen() {
  Owner expected = Owner::kLost;
  if (!owner_.compare_exchange_strong(expected, Owner::kOther)) return Done{};
  // New cuts see that they must not; earlier ones are waited for.
  while (cutting_.load() > 0) ::nanosleep(&kCutUnderWay, nullptr);
  inner_.close();
  Status opened = inner_.open();
  if (opened && !same_limits(inner_.limits(), limits_)) {
    inner_.close();
    opened = Error{"the device that was plugged in has other limits than the one before",
                   "plug the first one in again, or begin another session", name()};
  }
  if (opened) {
    times_back_.fetch_add(1, std::memory_order_relaxed);
    owner_.store(Owner::kServo);
  } else {
    owner_.store(Owner::kLost);
  }
  // The servo ended meanwhile and left it to this thread.
  if (ended_.load()) {
    close_from(Owner::kServo);
    close_from(Owner::kLost);
  }
  return opened;
}

}  // namespace palpate::device

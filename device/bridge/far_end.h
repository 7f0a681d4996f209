// The far end of the bridge: a device at this machine, felt by a program at another one. Forces that come
// over the network pass a governor of their own here, and this side's watchdog is the one that counts: cable
// and program of the other side may be gone.
//
//   - A command counts only once: its sequence must be after the last one that was accepted, of the same
//     session and address, undamaged, and finite.
//   - It must answer a state that was sent at most `most_age_s` ago, by this side's clock. What a network
//     held back is refused, however it comes; but a zero that is too old lets go, latched.
//   - Without an accepted command for `watchdog_s`: zero force, latched.
//   - Force begins after a command of exactly zero, with a soft start: at first, and after every latch.
//   - A release from anybody lets go at once, latched.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "device/bridge/datagrams.h"
#include "device/bridge/sent_times.h"
#include "device/interface/device.h"
#include "device/interface/force_governor.h"
#include "device/links/datagram_port.h"
#include "device/safety/heartbeat.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

struct FarEndOptions {
  double rate_hz = 1000.0;    ///< of tick()
  double watchdog_s = 0.020;  ///< no accepted command for longer: zero
  double most_age_s = 0.020;  ///< of the state that a command answers
  double user_limit_n = 0.0;  ///< 0: the device's own limit; the other side has its user's
  double slew_n_per_s = 1000.0;
  // Of this side's governor, and as there: a loop that is late, and a device that is silent.
  double late_zero_s = GovernorOptions{}.late_zero_s, latch_late_s = GovernorOptions{}.latch_late_s;
  double silence_s = GovernorOptions{}.silence_s;
};

struct FarEndCounters {
  std::uint64_t ticks = 0;
  std::uint64_t accepted = 0;   ///< commands
  std::uint64_t malformed = 0;  ///< no datagram
  std::uint64_t strange = 0;    ///< of another session or address
  std::uint64_t overtaken = 0;  ///< commands again, or after a newer one
  std::uint64_t old = 0;        ///< commands that answer an old state
  std::uint64_t trips = 0;      ///< of the watchdog
  std::uint64_t releases = 0;
  std::uint64_t sessions = 0;
};

/// Keeps references to device, port and clock. One thread ticks. The device gets zero at every end.
class FarEnd {
 public:
  FarEnd(Device& device, DatagramPort& port, const Clock& clock, const FarEndOptions& options) noexcept;
  FarEnd(const FarEnd&) = delete;
  FarEnd& operator=(const FarEnd&) = delete;
  ~FarEnd() { close(); }

  /// Opens the device and makes the governor for its limits. An Error names the option that is not right.
  [[nodiscard]] Status open();
  /// Zero force, and lets the device go.
  void close() noexcept;
  /// Beats in every tick, and is obeyed where it was tripped. Before open; null: nobody watches.
  void watched_by(Heartbeat* heart) noexcept { heart_ = heart; }

  /// Takes what has come, reads the device, governs, commands, tells. O(kMostDatagrams), no allocation.
  void tick() noexcept;

  [[nodiscard]] const FarEndCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] const ForceGovernor* governor() const noexcept { return governor_.get(); }
  /// Somebody's commands were accepted within the last second.
  [[nodiscard]] bool in_session() const noexcept;

  static constexpr int kMostDatagrams = 32;  ///< of a tick; what is left waits for the next one

 private:
  void receive() noexcept;
  void take(const Datagram& datagram, const Peer& from) noexcept;
  void greet(const Datagram& hello, const Peer& from) noexcept;
  void accept(const Datagram& command) noexcept;
  void release(const Datagram& datagram, const Peer& from) noexcept;
  void latch() noexcept;
  [[nodiscard]] Vec3 wanted() noexcept;
  void tell(const DeviceState& state) noexcept;
  void answer(Datagram datagram, const Peer& to) noexcept;

  Device& device_;
  DatagramPort& port_;
  const Clock& clock_;
  FarEndOptions options_;
  std::unique_ptr<ForceGovernor> governor_;
  Heartbeat* heart_ = nullptr;
  BridgeWelcome welcome_;
  Peer peer_;
  std::uint64_t session_ = 0;
  std::uint32_t sequence_ = 0, accepted_ = 0;
  std::int64_t accepted_ns_ = 0;
  bool has_session_ = false, has_accepted_ = false, open_ = false;
  Vec3 force_n_ = Vec3::Zero();
  SentTimes sent_;
  FarEndCounters counters_;
};

}  // namespace palpate::device

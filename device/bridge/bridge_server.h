// Far end of the bridge: serves a local device to a program at another machine. Its own governor and watchdog
// limit the received forces: the other side's cable and program may be gone.
//
//   - A command counts once: undamaged, finite, of the accepted session and address, with a later sequence.
//   - It must answer a state sent at most `max_age_s` ago by this side's clock, however the network delayed
//     it. An older zero still releases, latched.
//   - Zero force, latched, after `watchdog_s` without an accepted command.
//   - Force begins after a command of exactly zero, with a soft start, also after every latch.
//   - A release from anybody releases at once, latched.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/force_governor.h>
#include <palpate/device/heartbeat.h>
#include "device/bridge/datagrams.h"
#include "device/links/udp_link.h"

namespace palpate::device {

struct BridgeServerOptions {
  double rate_hz = 1000.0;    ///< of tick()
  double watchdog_s = 0.020;  ///< zero after this time without an accepted command
  double max_age_s = 0.020;   ///< of the state that a command answers
  double user_limit_n = 0.0;  ///< 0: the device's limit; the other side applies its user's
  double slew_n_per_s = 1000.0;
  // Limits of this side's governor for a late loop and a silent device.
  double late_zero_s = GovernorOptions{}.late_zero_s, latch_late_s = GovernorOptions{}.latch_late_s;
  double silence_s = GovernorOptions{}.silence_s;
};

struct BridgeServerCounters {
  std::uint64_t ticks = 0;
  std::uint64_t accepted = 0;   ///< commands
  std::uint64_t malformed = 0;  ///< no datagram
  std::uint64_t strange = 0;    ///< other session or address
  std::uint64_t overtaken = 0;  ///< commands repeated or overtaken
  std::uint64_t old = 0;        ///< commands that answer an old state
  std::uint64_t trips = 0;      ///< of the watchdog
  std::uint64_t releases = 0;
  std::uint64_t sessions = 0;
};

/// Keeps references to device, port and clock. One thread ticks. Every end sends zero to the device.
class BridgeServer {
 public:
  BridgeServer(Device& device, DatagramPort& port, const Clock& clock,
               const BridgeServerOptions& options) noexcept;
  BridgeServer(const BridgeServer&) = delete;
  BridgeServer& operator=(const BridgeServer&) = delete;
  ~BridgeServer() { close(); }

  /// Opens the device and makes the governor for its limits. An Error names the invalid option.
  [[nodiscard]] Status open();
  /// Commands zero and closes the device.
  void close() noexcept;
  /// Sets the watchdog's heartbeat, beaten in every tick; a trip is obeyed. Call before open(); null: no
  /// watchdog.
  void watched_by(Heartbeat* heart) noexcept { heart_ = heart; }

  /// Receives, reads the device, governs, commands, answers. O(kMaxDatagrams), no allocation.
  void tick() noexcept;

  [[nodiscard]] const BridgeServerCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] const ForceGovernor* governor() const noexcept { return governor_.get(); }
  /// True: a command was accepted within the last second.
  [[nodiscard]] bool in_session() const noexcept;

  static constexpr int kMaxDatagrams = 32;  ///< per tick; the rest waits for the next one

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
  BridgeServerOptions options_;
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
  BridgeServerCounters counters_;
};

}  // namespace palpate::device

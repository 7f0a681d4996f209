// A device at another machine, over datagrams. Both sides reject damaged, foreign, overtaken and old
// datagrams (far end: bridge_server.h).
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/device/link.h>
#include "device/bridge/datagrams.h"
#include "device/interface/driver_options.h"

namespace palpate::device {

struct BridgeOptions {
  std::string name = "bridge";
  std::uint64_t session = 1;                        ///< unique among programs: see new_session()
  double max_age_s = 0.020;                         ///< a state that answers an older command is not new
  int open_tries = 1000;                            ///< requests of open(), one wait apart
  std::function<void()> wait = [] { sleep_ms(); };  ///< between two tries
};

/// A random number from the operating system, unique among programs.
[[nodiscard]] std::uint64_t new_session();

struct BridgeCounters {
  std::uint64_t states = 0;        ///< accepted
  std::uint64_t malformed = 0;     ///< no datagram, or another session
  std::uint64_t overtaken = 0;     ///< not newer than the last, repetitions included
  std::uint64_t old = 0;           ///< answered a command sent too long ago
  std::uint64_t disobeying = 0;    ///< the far end holds zero whatever is commanded
  std::uint64_t lost = 0;          ///< sequence numbers that never came, or too late
  std::int64_t round_trip_ns = 0;  ///< of the newest state: since its command was sent
};

/// Owns its link; one datagram per poll. One thread between open and close; cut_force from any.
class BridgeDevice final : public Device {
 public:
  BridgeDevice(std::unique_ptr<Link> link, const Clock& clock, BridgeOptions options);
  ~BridgeDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return options_.name; }
  /// Succeeds when the far end has sent its limits, accepted a zero command, and obeys. An Error names the
  /// missing step.
  [[nodiscard]] Status open() override;
  /// Asks the far end to release until it confirms, at most 20 waits; after that its own watchdog releases.
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return welcome_.limits; }
  /// O(kMaxPolls) datagrams. Fresh only for a new, recent state of a far end that obeys; one that holds zero
  /// counts as silent.
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override { return link_->submit(release_.bytes()); }

  [[nodiscard]] const BridgeWelcome& welcome() const noexcept { return welcome_; }
  [[nodiscard]] const BridgeCounters& counters() const noexcept { return counters_; }

  static constexpr int kMaxPolls = 16;  ///< per frame; the rest waits for the next one

 private:
  [[nodiscard]] Status wait_for_welcome();
  [[nodiscard]] Status wait_for_obedience();
  void take(const Datagram& datagram, std::span<const std::uint8_t> bytes) noexcept;
  [[nodiscard]] bool is_newer(const Datagram& datagram) noexcept;
  void command(const Vec3& force_n) noexcept;

  std::unique_ptr<Link> link_;
  const Clock& clock_;
  BridgeOptions options_;
  std::int64_t most_age_ns_;
  DatagramBytes release_;
  BridgeWelcome welcome_;
  DeviceState state_;
  SentTimes sent_;
  BridgeCounters counters_;
  std::uint32_t sequence_ = 0, newest_ = 0;
  int malformed_in_a_row_ = 0;
  std::uint16_t far_flags_ = 0;
  bool open_ = false, has_newest_ = false, welcomed_ = false, busy_ = false, gone_ = false, released_ = false;
};

/// "bridge:HOST:PORT" or "bridge:HOST" (port kBridgePort). Options: most-age-ms.
void register_bridge_driver(Drivers& drivers);

/// For a guard process: tells the listener at HOST:PORT to release; returns whether it confirmed. Opens its
/// own socket. At most 50 ms plus host lookup.
[[nodiscard]] bool release_far_end(const std::string& host_and_port);

}  // namespace palpate::device

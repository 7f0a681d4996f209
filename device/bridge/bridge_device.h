// A device that stands at another machine, over datagrams. This side believes no datagram that is damaged, of
// another session, overtaken, or old; the far end (far_end.h) does the same with what is sent there.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include "device/bridge/datagrams.h"
#include "device/bridge/sent_times.h"
#include "device/interface/device.h"
#include "device/interface/link.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

struct BridgeOptions {
  std::string name = "bridge";
  std::uint64_t session = 1;   ///< unlike that of any other program: see new_session()
  double most_age_s = 0.020;   ///< a state that answers a command of longer ago tells nothing new
  int open_tries = 1000;       ///< how often open() asks, a wait apart
  std::function<void()> wait;  ///< between two tries; empty: a millisecond of sleep
};

/// A number that no other program has: of the machine's own randomness.
[[nodiscard]] std::uint64_t new_session();

/// What the two sides did to each other's datagrams.
struct BridgeCounters {
  std::uint64_t states = 0;        ///< that were believed
  std::uint64_t malformed = 0;     ///< no datagram, or of another session
  std::uint64_t overtaken = 0;     ///< a newer one had come; again and again ones too
  std::uint64_t old = 0;           ///< its command was sent too long ago
  std::uint64_t disobeying = 0;    ///< the far end holds zero, whatever is commanded
  std::uint64_t lost = 0;          ///< sequence numbers that never came, or came too late
  std::int64_t round_trip_ns = 0;  ///< of the newest state: since the command that it answers was sent
};

/// Owns its link, one datagram a poll. Between open and close one thread; cut_force any.
class BridgeDevice final : public Device {
 public:
  BridgeDevice(std::unique_ptr<Link> link, const Clock& clock, BridgeOptions options);
  ~BridgeDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return options_.name; }
  /// Ready when the far end has said its limits, has accepted a zero command, and obeys. An Error says which
  /// of it did not come.
  [[nodiscard]] Status open() override;
  /// Tells the far end to let go until it says that it did, for 20 waits at most; then its own watchdog does.
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return welcome_.limits; }
  /// O(kMostPolls) datagrams. Fresh only for a state that is newer than the last one, young, and of a far end
  /// that obeys: one that holds zero is as good as silent.
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override { return link_->submit(release_.bytes()); }

  [[nodiscard]] const BridgeWelcome& welcome() const noexcept { return welcome_; }
  [[nodiscard]] const BridgeCounters& counters() const noexcept { return counters_; }

  static constexpr int kMostPolls = 16;  ///< of a frame; what is left waits for the next one

 private:
  [[nodiscard]] Status wait_for_welcome();
  [[nodiscard]] Status wait_for_obedience();
  void take(const Datagram& datagram, std::span<const std::uint8_t> bytes) noexcept;
  [[nodiscard]] bool is_newer(const Datagram& datagram) noexcept;
  void command(const Vec3& force_n) noexcept;
  void wait() const;

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

}  // namespace palpate::device

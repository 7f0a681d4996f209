// What goes wrong between a servo and a board, over whatever library carries the bytes: how soon it is seen,
// and how soon the board has let go. Shared by the tests of real libraries, each of which brings its board.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/force_governor.h>
#include "device/interface/driver_options.h"

namespace palpate::device {

enum class LinkWrong : std::uint8_t {
  kSilent,
  kShort,
  kGarbled,
  kLate,
  kLost,
  kDuplicated,
  kUnplugged,
  kNan,
  kStuck,
  kKilled,
  kStopped,
};
inline constexpr int kLinkWrongs = 11;
/// As docs/results/hands-and-loops.md has it.
[[nodiscard]] const char* link_wrong_name(LinkWrong wrong) noexcept;

/// Between a board's replies and the link: what is set to go wrong, does. Any thread.
class SpoiltReplies {
 public:
  using Bytes = std::vector<std::uint8_t>;
  void set(LinkWrong wrong);
  void heal();
  /// What comes instead of this reply, in its order.
  [[nodiscard]] std::vector<Bytes> instead_of(Bytes reply);

 private:
  std::mutex mutex_;
  bool spoilt_ = false;
  LinkWrong wrong_ = LinkWrong::kSilent;
  Bytes last_;
  std::vector<Bytes> held_;
  std::uint64_t count_ = 0;
};

/// Whether a board's motors are commanded a force, and until when they were: told by the board itself, with
/// each command, so that nobody has to look in time. One thread tells, or several under one lock.
class HeldForce {
 public:
  void tell(bool holds) noexcept {
    if (!holds && holds_.load()) until_ns_.store(monotonic_ns());
    holds_.store(holds);
  }
  [[nodiscard]] bool holds() const noexcept { return holds_.load(); }
  /// The last moment with a force.
  [[nodiscard]] std::int64_t until_ns() const noexcept {
    return holds_.load() ? monotonic_ns() : until_ns_.load();
  }

 private:
  std::atomic<bool> holds_{false};
  std::atomic<std::int64_t> until_ns_{0};
};

/// A device over a library, and the board at its other end, which holds the last force that it was commanded.
class LinkBench {
 public:
  LinkBench() = default;
  LinkBench(const LinkBench&) = delete;
  LinkBench& operator=(const LinkBench&) = delete;
  virtual ~LinkBench() = default;
  [[nodiscard]] virtual std::string link() const = 0;
  [[nodiscard]] virtual Device& device() = 0;
  virtual void unplug() = 0;
  virtual void plug() = 0;
  /// A packet that comes again is known as such.
  [[nodiscard]] virtual bool counts_packets() const = 0;
  /// Name and options of the device for a program of its own.
  [[nodiscard]] virtual std::vector<std::string> program() const = 0;
  SpoiltReplies replies;
  HeldForce held;
};

struct LinkFaultOptions {
  /// The governor's own limits of time, and those of a session; else so long ones that a busy machine trips
  /// nothing by itself.
  bool as_in_a_session = false;
};

struct LinkFaultOutcome {
  bool counts = false;         ///< it pressed, and went wrong only when told to
  Fault fault = Fault::kNone;  ///< none for a death: the guard saw it
  bool died = false;
  double detected_ms = -1.0, zero_ms = -1.0;
  bool commanded_zero = true;  ///< from the frame of the detection on
  bool held_at_end = false;
  bool within_two_ticks = false;  ///< the board too
};

/// Presses with 1 N, lets it go wrong, waits for zero, or, of what nobody can see, for a while. What cannot
/// be seen or need not be ends with the force still there.
[[nodiscard]] LinkFaultOutcome run_link_fault(LinkBench& bench, LinkWrong wrong,
                                              const LinkFaultOptions& options);

/// Runs a device of the program's in a process that presses until it is killed: arguments as program() gives
/// them, and the guard's patience in ms.
[[noreturn]] void press_until_killed(const std::vector<std::string>& arguments);
inline constexpr const char* kPressArgument = "--press-until-killed";

/// All faults of a bench, `runs` times each: a row of Markdown each on standard output, and the rows as JSON.
/// False: a run did not end in zero where it must.
[[nodiscard]] bool measure_link_faults(LinkBench& bench, int runs, std::string& rows_json);
/// "--faults RUNS FILE.json" of a program: measures, with what priority the system gives, and writes. The
/// exit status.
[[nodiscard]] int measured_faults(int argc, char** argv,
                                  const std::function<bool(int, std::string&)>& measure);
/// As measure_link_faults(), over the real libusb; over the real hidapi, a terminal and UDP sockets.
[[nodiscard]] bool measure_usb_faults(int runs, std::string& rows_json);
[[nodiscard]] bool measure_hid_faults(int runs, std::string& rows_json);
/// A value of a device's facts; empty: there is none of that key.
[[nodiscard]] inline std::string fact_of(const DeviceFacts& facts, const std::string& key) {
  for (const auto& [name, value] : facts)
    if (name == key) return value;
  return {};
}
/// For tests, once: what does not hold, in words; empty: all does.
[[nodiscard]] std::string violations_of(LinkBench& bench, LinkWrong wrong);

}  // namespace palpate::device

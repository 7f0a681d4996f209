// A process that commands zero force when the program dies. It may die of any cause (kill -9, crash, out of
// memory). Devices may hold their last torque for ever, and a dead program cannot stop them.
//
// First:
//   auto guard = palpate::device::Guard::start([&] { return fresh.zero(); });  // first of all: it forks
//   if (!guard) return failed(guard.error());
//   servo.watched_by(&guard->heartbeat());
#pragma once

#include <sys/types.h>

#include <functional>
#include <memory>

#include <palpate/device/heartbeat.h>
#include <palpate/result.h>

namespace palpate::device {

struct GuardOptions {
  /// A stopped (SIGSTOP) or hanging program holds the device. After this long without a heartbeat the guard
  /// kills it and commands zero. 0: never.
  double kill_after_s = 0.0;
  bool debugger = false;  ///< never kills: breakpoints stop the heartbeat too. A detected tracer has the same
                          ///< effect
  double retry_s = 2.0;   ///< time for commanding zero; the kernel may briefly hold the device
};

/// Start it before opening the link and before scene and threads exist, which would be forked along. It has
/// its own session, ignores SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGPIPE, holds no file of the program but
/// standard error, and blocks. It acts when the kernel reports the program's end, also a normal one: one more
/// zero.
class Guard {
 public:
  /// Runs in the guard's process after the program's end: commands zero through its own handle. False: retry.
  using Zero = std::function<bool()>;

  /// Errors: the process cannot be forked (as under ThreadSanitizer), or invalid options.
  [[nodiscard]] static Result<Guard> start(const Zero& zero, const GuardOptions& options = {});
  Guard(Guard&&) noexcept;
  Guard& operator=(Guard&&) noexcept;
  /// As stop().
  ~Guard();

  /// For the servo; in shared memory.
  [[nodiscard]] Heartbeat& heartbeat() noexcept;
  [[nodiscard]] pid_t pid() const noexcept;
  /// False: the guard was killed.
  [[nodiscard]] bool alive() noexcept;
  /// Lets it command zero a last time and waits for its end, up to Zero's time and retry_s. Close the device
  /// first.
  void stop() noexcept;

  static constexpr int kPriority = 70;

 private:
  struct State;
  explicit Guard(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device

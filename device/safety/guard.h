// A process of its own that commands zero force when the program dies, of whatever: kill -9, a crash, the end
// of its memory. A device may hold its last torque for ever; nothing inside the dead program can help then.
#pragma once

#include <sys/types.h>

#include <functional>
#include <memory>

#include "device/safety/heartbeat.h"
#include "toolkit/core/result.h"

namespace palpate::device {

struct GuardOptions {
  /// A program that is stopped (SIGSTOP) or hangs holds the device and sends nothing. Without a heartbeat for
  /// so long the guard kills it, and then commands zero. 0: never.
  double kill_after_s = 0.0;
  bool debugger =
      false;             ///< never kills: a breakpoint stops the heart too. A tracer that is seen counts too.
  double retry_s = 2.0;  ///< how long it tries to command zero; the kernel may hold the device for a moment
};

/// Start it before the link is opened and before scene and threads are there: what it needs is forked with
/// it. It stands in a session of its own, ignores SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGPIPE, holds no
/// file of the program but its standard error, and blocks. It acts when the kernel says that the program is
/// gone, and also at a normal end: one zero more.
class Guard {
 public:
  /// Run in the guard's process after the program's end: opens a handle of its own and commands zero. False:
  /// not yet, try again.
  using Zero = std::function<bool()>;

  /// An Error where the process cannot be forked (ThreadSanitizer forbids it), or for options that are not
  /// right.
  [[nodiscard]] static Result<Guard> start(const Zero& zero, const GuardOptions& options = {});
  Guard(Guard&&) noexcept;
  Guard& operator=(Guard&&) noexcept;
  /// As stop().
  ~Guard();

  /// For the servo. In memory that both processes share.
  [[nodiscard]] Heartbeat& heartbeat() noexcept;
  [[nodiscard]] pid_t pid() const noexcept;
  /// False: it was killed, and nobody guards.
  [[nodiscard]] bool alive() noexcept;
  /// Lets it command zero a last time and waits for its end: as long as Zero takes, up to retry_s. Close the
  /// device before.
  void stop() noexcept;

  static constexpr int kPriority = 70;

 private:
  struct State;
  explicit Guard(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device

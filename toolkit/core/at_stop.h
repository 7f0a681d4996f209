// What must be done before a program that is told to stop (Ctrl-C) may end at once: half-written files
// removed, child processes ended, the user told what is kept. Nothing waits for long work to notice: every
// result stands whole on the disk from the moment it is complete, so a program may end between any two
// instructions. The library only keeps the list; whose signals they are, the application decides
// (experiments/command).
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <string>

namespace palpate {

/// An action for the case that the program is stopped while this lives. It answers a sentence for the user,
/// or nothing. Movable; any thread may make and drop one.
class AtStop {
 public:
  using Action = std::function<std::string()>;
  AtStop() noexcept = default;
  explicit AtStop(Action action);
  AtStop(AtStop&& other) noexcept;
  AtStop& operator=(AtStop&& other) noexcept;
  ~AtStop() { drop(); }

  /// The action is no longer needed.
  void drop() noexcept;

 private:
  std::uint64_t id_ = 0;  ///< 0: none
};

/// While this is held no stop begins: between starting a child and noting how to end it.
[[nodiscard]] std::unique_lock<std::recursive_mutex> hold_stop();

/// Runs every action, the newest first, and returns what they say, in that order, joined by "; ". From here
/// on nobody can make or drop an action: it is for the thread that ends the program next, and for it alone.
[[nodiscard]] std::string run_stop_actions();

/// For a process that was forked from this one, right after and by the only thread: what the other one must
/// do is not its own. The fork is to be made under hold_stop(); the forked process forgets that lock as well,
/// and must not give it back.
void forget_stop_actions();

}  // namespace palpate

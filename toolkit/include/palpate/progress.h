// Long work: reports of its progress, and what to do where the program is stopped. The library only reports;
// the application displays.
//
// Stop callbacks run before a stopped program (Ctrl-C) ends: remove half-written files, end child processes,
// tell the user what is kept. Results on disk are always complete, so a program may end at any instruction.
// The library keeps the list; the application handles the signals (experiments/command):
//   palpate::StopCallback on_stop([&] {
//     save();
//     return std::string("session.rec is kept");
//   });
//   // .. in the thread that waits for SIGINT, and ends the program next:
//   std::fprintf(stderr, "%s\n", palpate::run_stop_callbacks().c_str());
//
// First:
//   struct Dots final : palpate::Progress {
//     void report(std::string_view what, double) override { std::puts(std::string(what).c_str()); }
//   } dots;
//   auto report = renderer->prepare(scene, {.progress = &dots});
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>

namespace palpate {

/// A progress sink. Called from one thread at a time, which may be any thread.
class Progress {
 public:
  virtual ~Progress() = default;
  /// `fraction` in [0, 1] of phase `what`; negative if unknown.
  virtual void report(std::string_view what, double fraction) = 0;
  /// True when the user asked to stop; long work then soon returns an Error.
  [[nodiscard]] virtual bool cancelled() const { return false; }
};

/// A sink that ignores reports.
Progress& no_progress() noexcept;

/// An action to run if the program is stopped during its lifetime. It returns a sentence for the user, or
/// nothing. Movable; thread-safe to make and drop.
class StopCallback {
 public:
  using Action = std::function<std::string()>;
  StopCallback() noexcept = default;
  explicit StopCallback(Action action);
  StopCallback(StopCallback&& other) noexcept;
  StopCallback& operator=(StopCallback&& other) noexcept;
  ~StopCallback() { drop(); }

  /// Removes the action.
  void drop() noexcept;

 private:
  std::uint64_t id_ = 0;  ///< 0: none
};

/// Blocks a stop while held, for example between starting a child and registering its end.
[[nodiscard]] std::unique_lock<std::recursive_mutex> block_stop();

/// Runs every action, newest first, and returns their sentences joined by "; ". No action can be made or
/// dropped afterwards. Only for the thread that ends the program next.
[[nodiscard]] std::string run_stop_callbacks();

/// For a forked process: call it at once, in its only thread, to forget the parent's actions. Fork under
/// block_stop(); the child forgets that lock too and must not release it.
void forget_stop_callbacks();

}  // namespace palpate

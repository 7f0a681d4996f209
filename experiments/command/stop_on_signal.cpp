#include "experiments/command/cli.h"

#include <poll.h>
#include <semaphore.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <string>
#include <thread>

#include <palpate/clock.h>
#include <palpate/progress.h>
#include "experiments/session/session.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

// Some send a signal twice at once, to the process and to its group. A person's second Ctrl-C comes later.
constexpr std::int64_t kSameSignalNs = 200'000'000;

sem_t asked;
volatile std::sig_atomic_t signal_number = 0;
std::atomic<std::int64_t> first_ns{0};
static_assert(std::atomic<std::int64_t>::is_always_lock_free, "a handler may not wait");

// A thread of its own does the rest: a handler may hardly do anything, and the main thread may be in the
// midst of a library that cannot be interrupted.
extern "C" void on_stop(int number) {
  const std::int64_t now = monotonic_ns();
  std::int64_t none = 0;
  if (first_ns.compare_exchange_strong(none, now)) {
    signal_number = number;
    ::sem_post(&asked);
  } else if (now - none > kSameSignalNs) {
    ::_exit(kSignalBase + number);
  }
}

/// A text that cannot be written at once is dropped: nobody may be reading.
void say(const std::string& text) {
  pollfd out{STDERR_FILENO, POLLOUT, 0};
  if (::poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0)
    if (::write(STDERR_FILENO, text.data(), text.size()) < 0) return;
}

/// Waits for a signal.
void wait_until_asked() {
  while (::sem_wait(&asked) != 0) {
  }
}

[[noreturn]] void wait_and_stop() {
  const std::string stopped =
      (::isatty(STDERR_FILENO) == 1 ? "\r\033[K" : "") + std::string("palpate: stopped");
  wait_until_asked();
  if (ends_on_stop(signal_number)) {
    say(stopped + ": the report of what was felt is being written; a second signal ends that too\n");
    std::this_thread::sleep_for(std::chrono::nanoseconds(kSameSignalNs));
    first_ns.store(0);
    wait_until_asked();
  }
  const std::string said = run_stop_callbacks();
  say(stopped + (said.empty() ? "" : ": " + said) + "\n");
  ::_exit(kSignalBase + signal_number);
}

}  // namespace

void stop_on_signals() {
  std::signal(SIGPIPE, SIG_IGN);
  ::sem_init(&asked, 0, 0);
  std::thread(wait_and_stop).detach();
  struct sigaction action {};
  action.sa_handler = on_stop;
  action.sa_flags = SA_RESTART;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  struct sigaction before {};
  ::sigaction(SIGHUP, nullptr, &before);
  if (before.sa_handler != SIG_IGN) ::sigaction(SIGHUP, &action, nullptr);  // nohup
}

}  // namespace palpate::experiments

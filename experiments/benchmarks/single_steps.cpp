#include "experiments/benchmarks/single_steps.h"

#include <fmt/format.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <new>

namespace palpate {
namespace {

/// Waits until the traced process stops or ends; false with its status if it ended.
bool stopped(pid_t traced, int& signal, int& status) {
  int what = 0;
  if (::waitpid(traced, &what, 0) != traced) {
    status = 1;
    return false;
  }
  if (WIFSTOPPED(what)) {
    signal = WSTOPSIG(what);
    return true;
  }
  status = WIFEXITED(what) ? WEXITSTATUS(what) : 1;
  return false;
}

/// Steps through one part; false if the process ended within it.
bool step_through(pid_t traced, const SteppedPart& part, int& status) {
  std::uint64_t instructions = 0;
  int signal = SIGTRAP;
  while (part.counting()) {
    // Foreign signals are passed on.
    const long passed = signal == SIGTRAP ? 0 : signal;
    if (::ptrace(PTRACE_SINGLESTEP, traced, nullptr, passed) != 0) return false;
    if (!stopped(traced, signal, status)) return false;
    ++instructions;
  }
  fmt::print("{} {}\n", part.text(), instructions);
  std::fflush(stdout);
  return true;
}

/// Pins both processes to one processor, so a step wakes no second one.
void share_processor(pid_t traced) noexcept {
  const int here = ::sched_getcpu();
  if (here < 0) return;
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(static_cast<std::size_t>(here), &one);
  ::sched_setaffinity(0, sizeof one, &one);
  ::sched_setaffinity(traced, sizeof one, &one);
}

int trace(pid_t traced, const SteppedPart& part) {
  int status = 1, signal = 0;
  if (!stopped(traced, signal, status)) return status;
  ::ptrace(PTRACE_SETOPTIONS, traced, nullptr, PTRACE_O_EXITKILL);
  long passed = 0;
  while (::ptrace(PTRACE_CONT, traced, nullptr, passed) == 0) {
    if (!stopped(traced, signal, status)) return status;
    passed = signal == SIGTRAP ? 0 : signal;
    if (signal == SIGTRAP && part.counting() && !step_through(traced, part, status)) return status;
  }
  return 1;
}

}  // namespace

void SteppedPart::name(const std::string& text) noexcept {
  const std::size_t size = std::min(text.size(), kMostName);
  std::copy_n(text.data(), size, name_.data());
  name_[size] = '\0';
}

void SteppedPart::begin() noexcept {
  counting_ = 1;
  std::raise(SIGTRAP);  // the other process single-steps from here
}

int run_stepped(const std::function<int(SteppedPart*)>& work) {
  void* const shared =
      ::mmap(nullptr, sizeof(SteppedPart), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (shared == MAP_FAILED) return 1;
  auto* const part = new (shared) SteppedPart;
  std::fflush(nullptr);  // else both processes would write the buffers
  const pid_t traced = ::fork();
  if (traced == 0) {
    if (::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) ::_exit(1);
    std::raise(SIGSTOP);
    ::_exit(work(part));
  }
  if (traced > 0) share_processor(traced);
  const int status = traced > 0 ? trace(traced, *part) : 1;
  ::munmap(shared, sizeof(SteppedPart));
  return status;
}

}  // namespace palpate

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <new>
#include <string>
#include <utility>

#include <palpate/clock.h>
#include <palpate/device/guard.h>
#include <palpate/device/watchdog.h>
#include <palpate/progress.h>

namespace palpate::device {
namespace {

constexpr double kNsPerSecond = 1e9, kMsPerSecond = 1e3;
constexpr double kLooksPerLimit = 10.0;       // a stall is seen at most two looks after the limit
constexpr useconds_t kBetweenTriesUs = 1000;  // while the kernel still holds the device
constexpr int kFirstFile = 3;                 // after the standard ones
constexpr int kSeenClosed = 256;              // more files than a session opens, in far below a millisecond
constexpr int kIgnored[] = {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE};

/// Blocks the signals that the guard will ignore until it does.
class HeldBack {
 public:
  HeldBack() noexcept {
    sigset_t held;
    ::sigemptyset(&held);
    for (const int number : kIgnored) ::sigaddset(&held, number);
    ::pthread_sigmask(SIG_BLOCK, &held, &before_);
  }
  HeldBack(const HeldBack&) = delete;
  HeldBack& operator=(const HeldBack&) = delete;
  ~HeldBack() { ::pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

 private:
  sigset_t before_{};
};

/// Readable when this process is gone, whoever else holds its sockets. Negative without kernel support.
int own_end() noexcept {
#ifdef SYS_pidfd_open
  return static_cast<int>(::syscall(SYS_pidfd_open, ::getpid(), 0));
#else
  return -1;
#endif
}

/// A traced process is not hanging.
bool is_traced(pid_t process) {
  std::ifstream status("/proc/" + std::to_string(process) + "/status");
  const std::string key = "TracerPid:";
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(key)) return line.find_first_of("123456789", key.size()) != std::string::npos;
  return false;
}

/// Closes all files except the standard ones and these, which move to the first places.
std::array<int, 2> keep_alone(std::array<int, 2> kept) noexcept {
  const int null = ::open("/dev/null", O_RDWR);
  ::dup2(null, STDIN_FILENO);
  ::dup2(null, STDOUT_FILENO);  // readers of the program's output must see its end
  // Moves above both places first, or one would overwrite the other.
  for (int& fd : kept)
    if (fd >= 0) fd = ::fcntl(fd, F_DUPFD, kFirstFile + static_cast<int>(kept.size()));
  int next = kFirstFile;
  for (int& fd : kept)
    if (fd >= 0) fd = ::dup2(fd, next++);
  // One by one first: an interposed library with a file table only sees `close`, and would confuse later
  // files of the same number.
  for (int fd = next; fd < kSeenClosed; ++fd) ::close(fd);
  ::close_range(kSeenClosed, ~0U, 0);
  return kept;
}

struct Watched {
  pid_t program;
  std::array<int, 2> ends;  // its socket, and its process
  const Heartbeat* heart;
  GuardOptions options;
};

/// Returns when the program is gone.
void wait_for_end(const Watched& watched) {
  const bool kills = watched.options.kill_after_s > 0.0 && !watched.options.debugger;
  const double look_ms = std::max(1.0, watched.options.kill_after_s * kMsPerSecond / kLooksPerLimit);
  StallDetector detector(std::llround(watched.options.kill_after_s * kNsPerSecond));
  std::array<pollfd, 2> ends = {pollfd{watched.ends[0], POLLIN, 0}, pollfd{watched.ends[1], POLLIN, 0}};
  for (;;) {
    const int news = ::poll(ends.data(), ends.size(), kills ? static_cast<int>(look_ms) : -1);
    if (news > 0) return;
    if (news < 0 && errno != EINTR) return;
    if (!kills || !detector.stalled(*watched.heart, monotonic_ns())) continue;
    if (is_traced(watched.program))
      detector.restart();
    else
      ::kill(watched.program, SIGKILL);
  }
}

[[noreturn]] void guard(const Watched& asked, const Guard::Zero& zero) {
  ::setsid();  // not reached by signals to the program's group
  for (const int number : kIgnored) std::signal(number, SIG_IGN);
  Watched watched = asked;
  watched.ends = keep_alone(asked.ends);
  sched_param priority{};
  priority.sched_priority = Guard::kPriority;
  ::sched_setscheduler(0, SCHED_FIFO, &priority);  // if allowed
  const char ready = 1;
  ::send(watched.ends[0], &ready, 1, MSG_NOSIGNAL);
  wait_for_end(watched);
  const Stopwatch watch;
  while (!zero() && watch.ms() < watched.options.retry_s * kMsPerSecond) ::usleep(kBetweenTriesUs);
  ::_exit(0);
}

}  // namespace

struct Guard::State {
  ~State() {
    if (shared != MAP_FAILED) ::munmap(shared, sizeof(Heartbeat));
  }
  void* shared = MAP_FAILED;
  Heartbeat* heart = nullptr;
  pid_t process = -1;
  int socket = -1;
};

Guard::Guard(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
Guard::Guard(Guard&&) noexcept = default;
Guard& Guard::operator=(Guard&& other) noexcept {
  if (this == &other) return *this;
  stop();
  state_ = std::move(other.state_);
  return *this;
}
Guard::~Guard() {
  stop();
}

Result<Guard> Guard::start(const Zero& zero, const GuardOptions& options) {
#if defined(__SANITIZE_THREAD__) || defined(PALPATE_STD_THREADS)
  return Error{"this build cannot be forked", "use one without ThreadSanitizer"};
#endif
  if (!zero || !std::isfinite(options.kill_after_s) || options.kill_after_s < 0.0 ||
      !std::isfinite(options.retry_s) || options.retry_s < 0.0)
    return Error{"the guard's options are not right", "give finite times, 0 or above"};
  const auto cannot = [](const char* what) {
    return Error{std::string("the guard process: ") + what + ": " + std::strerror(errno),
                 "close other programs"};
  };
  auto state = std::make_unique<State>();
  state->shared =
      ::mmap(nullptr, sizeof(Heartbeat), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (state->shared == MAP_FAILED) return cannot("no shared memory");
  state->heart = new (state->shared) Heartbeat;
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) return cannot("no socket");
  const int own = own_end();
  const pid_t program = ::getpid();
  {
    const auto hold = block_stop();
    const HeldBack held_back;
    state->process = ::fork();
    if (state->process == 0) {
      forget_stop_callbacks();
      ::close(ends[1]);
      guard({program, {ends[0], own}, state->heart, options}, zero);
    }
  }
  ::close(ends[0]);
  if (own >= 0) ::close(own);
  state->socket = ends[1];
  if (state->process < 0) {
    ::close(ends[1]);
    return cannot("it cannot be forked");
  }
  Guard made(std::move(state));
  char ready = 0;
  ssize_t came = -1;
  do {
    came = ::recv(ends[1], &ready, 1, 0);
  } while (came < 0 && errno == EINTR);
  if (came != 1) return Error{"the guard process ended before it began", "look into the system's log"};
  return made;
}

Heartbeat& Guard::heartbeat() noexcept {
  return *state_->heart;
}

pid_t Guard::pid() const noexcept {
  return state_ == nullptr ? -1 : state_->process;
}

bool Guard::alive() noexcept {
  if (state_ == nullptr || state_->process < 0) return false;
  if (::waitpid(state_->process, nullptr, WNOHANG) == 0) return true;
  state_->process = -1;
  return false;
}

void Guard::stop() noexcept {
  if (state_ == nullptr || state_->socket < 0) return;
  ::close(std::exchange(state_->socket, -1));
  if (state_->process < 0) return;
  while (::waitpid(state_->process, nullptr, 0) < 0 && errno == EINTR) {
  }
  state_->process = -1;
}

namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

std::int64_t watchdog_ns(double seconds) noexcept {
  return std::llround(seconds * static_cast<double>(kNsPerS));
}

}  // namespace

Watchdog::Watchdog(Device& device, Heartbeat& heart, const WatchdogOptions& options) noexcept
    : device_(device),
      heart_(heart),
      options_(options),
      limit_ns_(watchdog_ns(options.limit_s)),
      every_ns_(watchdog_ns(options.every_s)),
      detector_(limit_ns_) {}

Status Watchdog::start() {
  constexpr double kMaxS = 1.0;  // a force held for longer helps nobody
  if (!(options_.every_s > 0.0) || !(options_.limit_s > 2.0 * options_.every_s) || options_.limit_s > kMaxS)
    return Error{"the watchdog looks every " + std::to_string(options_.every_s) + " s for a limit of " +
                     std::to_string(options_.limit_s) + " s",
                 "give a limit of 1 s or less, and looks more than twice as often"};
  stop();
  ending_.store(false);
  thread_ = std::thread([this] { run(); });
  return Done{};
}

void Watchdog::stop() noexcept {
  if (!thread_.joinable()) return;
  ending_.store(true);
  thread_.join();
  // Nobody watches from here on.
  if (heart_.expected()) device_.cut_force();
}

void Watchdog::look(std::int64_t now_ns) noexcept {
  const bool late = last_look_ns_ >= 0 && now_ns - last_look_ns_ > limit_ns_ / 2;
  const std::uint64_t count = heart_.count();
  const bool still = heart_.expected() && count == last_count_;
  last_look_ns_ = now_ns;
  last_count_ = count;
  if (late) {
    late_looks_.fetch_add(1, std::memory_order_relaxed);
    detector_.restart();
    if (still) device_.cut_force();
  }
  if (detector_.stalled(heart_, now_ns) && !heart_.tripped()) {
    tripped_ns_.store(now_ns, std::memory_order_relaxed);
    heart_.trip();
    trips_.fetch_add(1, std::memory_order_relaxed);
  }
  if (heart_.tripped()) device_.cut_force();
}

void Watchdog::run() noexcept {
  sched_param priority{};
  priority.sched_priority = kPriority;
  real_time_.store(::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority) == 0);
  std::int64_t next_ns = monotonic_ns();
  while (!ending_.load()) {
    const std::int64_t now_ns = monotonic_ns();
    look(now_ns);
    next_ns += every_ns_;
    if (next_ns < now_ns) next_ns = now_ns + every_ns_;  // skipped, not caught up
    const timespec until{static_cast<time_t>(next_ns / kNsPerS), static_cast<long>(next_ns % kNsPerS)};
    ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
}

}  // namespace palpate::device

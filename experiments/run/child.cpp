#include "experiments/run/work.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include <palpate/clock.h>
#include <palpate/progress.h>
#include "toolkit/core/parallel.h"

namespace palpate::experiments {
namespace {

using ChildJson = nlohmann::json;

// Messages: one of these, the length of what follows in eight bytes, and that.
constexpr char kAnswer = '+', kFailed = '-', kProgress = '%';

bool send_all(int fd, const void* data, std::size_t bytes) {
  const char* from = static_cast<const char*>(data);
  while (bytes > 0) {
    const ssize_t n = ::send(fd, from, bytes, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    from += n;
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
}

bool receive_all(int fd, void* data, std::size_t bytes) {
  char* into = static_cast<char*>(data);
  while (bytes > 0) {
    const ssize_t n = ::recv(fd, into, bytes, 0);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    into += n;
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
}

bool send_message(int fd, char kind, const std::string& text) {
  const std::uint64_t length = text.size();
  return send_all(fd, &kind, 1) && send_all(fd, &length, sizeof(length)) &&
         send_all(fd, text.data(), text.size());
}

bool receive_message(int fd, char& kind, std::string& text) {
  std::uint64_t length = 0;
  if (!receive_all(fd, &kind, 1) || !receive_all(fd, &length, sizeof(length))) return false;
  text.resize(length);
  return receive_all(fd, text.data(), length);
}

std::string message_of(const ChildJson& json) {
  return json.dump(-1, ' ', false, ChildJson::error_handler_t::replace);
}

std::string error_text(const Error& error) {
  return message_of({{"what", error.what},
                     {"remedy", error.remedy},
                     {"file", error.file},
                     {"line", error.line},
                     {"gave_up", error.gave_up}});
}

Error error_of(const std::string& text) {
  const ChildJson j = ChildJson::parse(text, nullptr, false);
  if (!j.is_object()) return Error{"the renderer's process answered what is no answer"};
  Error error{j.value("what", ""), j.value("remedy", ""), j.value("file", ""),
              j.value("line", std::int64_t{0})};
  error.gave_up = j.value("gave_up", false);
  return error;
}

/// Hands progress to the other process, not oftener than a bar is drawn.
class FarProgress final : public Progress {
 public:
  explicit FarProgress(int fd) : fd_(fd) {}
  void report(std::string_view what, double fraction) override {
    constexpr std::int64_t kEveryNs = 100'000'000;
    const std::int64_t now_ns = monotonic_ns();
    if (what == what_ && now_ns - last_ns_ < kEveryNs) return;
    last_ns_ = now_ns;
    what_ = what;
    static_cast<void>(send_message(fd_, kProgress, message_of({{"what", what_}, {"fraction", fraction}})));
  }

 private:
  int fd_;
  std::string what_;
  std::int64_t last_ns_ = 0;
};

/// Our ends of what leads to forked processes: a further one must not hold them open.
std::set<int>& our_ends() {
  static std::set<int> ends;
  return ends;
}

/// Ends this process, and what it has started, when the other one is gone or lets go.
void end_with(int life) {
  pollfd watched{life, POLLIN, 0};
  while (::poll(&watched, 1, -1) < 0 && errno == EINTR) {
  }
  static_cast<void>(run_stop_callbacks());
  ::_exit(1);
}

[[noreturn]] void serve(int talk, int life, const Child::Work& work, const ChildLimits& limits) {
  std::thread([life] { end_with(life); }).detach();
  if (limits.bytes > 0) {
    const rlimit memory{limits.bytes, limits.bytes}, none{0, 0};
    ::setrlimit(RLIMIT_DATA, &memory);
    ::setrlimit(RLIMIT_CORE, &none);
  }
  FarProgress progress(talk);
  for (std::uint64_t task = 0; receive_all(talk, &task, sizeof(task));) {
    const Result<std::string> answer = work(task, progress);
    if (!send_message(talk, answer ? kAnswer : kFailed, answer ? *answer : error_text(answer.error()))) break;
  }
  ::_exit(0);  // what this process has of the other one is not its to end
}

}  // namespace

struct Child::State {
  Work work;
  ChildLimits limits;
  pid_t pid = 0;  ///< 0: in this process, or gone
  int talk = -1, life = -1;
  StopCallback stop_callback;

  void fork_off();
  void end() noexcept;
  bool hears_in_time(double until_s, std::int64_t until_ns) const noexcept;
  [[nodiscard]] double processor_seconds() const noexcept;
  Error how_it_ended();
};

void Child::State::fork_off() {
  int talks[2], lives[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, talks) != 0) return;
  if (::pipe2(lives, O_CLOEXEC) != 0) {
    ::close(talks[0]);
    ::close(talks[1]);
    return;
  }
  auto hold = block_stop();
  std::fflush(nullptr);  // or both processes would write it
  pid = ::fork();
  if (pid == 0) {
    forget_stop_callbacks();
    // Ctrl-C on the terminal reaches all processes: the other one ends this one.
    std::signal(SIGINT, SIG_IGN);
    std::signal(SIGTERM, SIG_DFL);
    for (const int end : our_ends()) ::close(end);
    ::close(talks[0]);
    ::close(lives[1]);
    static_cast<void>(hold.release());  // forgotten with the actions
    serve(talks[1], lives[0], work, limits);
  }
  ::close(talks[1]);
  ::close(lives[0]);
  if (pid < 0) {
    pid = 0;
    ::close(talks[0]);
    ::close(lives[1]);
    return;
  }
  talk = talks[0];
  life = lives[1];
  our_ends().insert({talk, life});
  stop_callback = StopCallback([this] {
    end();
    return std::string();
  });
}

void Child::State::end() noexcept {
  if (life >= 0) ::close(std::exchange(life, -1));
  // The thread that stops the program and the one that asks may both be here: each has its own copy, and who
  // comes second is told that there is no such child. 0 would mean the whole group.
  const pid_t child = pid;
  if (child <= 0) return;
  constexpr int kPatienceMs = 2000, kLookMs = 2;  // it ends what it has started first
  for (int ms = 0; ms < kPatienceMs; ms += kLookMs) {
    if (::waitpid(child, nullptr, WNOHANG) != 0) {
      pid = 0;
      return;
    }
    ::poll(nullptr, 0, kLookMs);
  }
  ::kill(child, SIGKILL);
  while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
  }
  pid = 0;
}

/// Processor time, so that a busy machine fails no task.
double Child::State::processor_seconds() const noexcept {
  clockid_t clock{};
  timespec spent{};
  if (::clock_getcpuclockid(pid, &clock) != 0 || ::clock_gettime(clock, &spent) != 0) return 0.0;
  return static_cast<double>(spent.tv_sec) + 1e-9 * static_cast<double>(spent.tv_nsec);
}

/// False once the process has used its time and said nothing.
bool Child::State::hears_in_time(double until_s, std::int64_t until_ns) const noexcept {
  constexpr int kLookMs = 200;
  for (;;) {
    pollfd watched{talk, POLLIN, 0};
    if (::poll(&watched, 1, kLookMs) > 0) return true;
    if (processor_seconds() > until_s || monotonic_ns() > until_ns) return false;
  }
}

Error Child::State::how_it_ended() {
  int status = 0;
  const pid_t child = std::exchange(pid, 0);
  while (child > 0 && ::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return {WIFSIGNALED(status) ? fmt::format("its process was ended by signal {} ({})", WTERMSIG(status),
                                            ::strsignal(WTERMSIG(status)))
                              : fmt::format("its process ended with status {}", WEXITSTATUS(status)),
          "take a smaller model, or report a crash",
          {},
          0};
}

Child::Child(Work work, bool apart, const ChildLimits& limits)
    : state_(new State{std::move(work), limits, 0, -1, -1, {}}) {
  if (apart && stop_idle_workers()) state_->fork_off();
}

Child::~Child() {
  state_->stop_callback.drop();
  if (state_->talk < 0) return;
  our_ends().erase(state_->talk);
  our_ends().erase(state_->life);
  ::close(state_->talk);
  state_->end();
}

Result<std::string> Child::ask(std::uint64_t task, Progress& progress) {
  State& s = *state_;
  if (s.talk < 0) return s.work(task, progress);
  if (s.pid <= 0) return Error{"its process has ended"};
  // The wall clock's limit is for tasks that wait.
  constexpr double kWaits = 10.0;
  const bool limited = s.limits.task_s > 0.0;
  const double until_s = s.processor_seconds() + s.limits.task_s;
  const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(1e9 * kWaits * s.limits.task_s);
  bool good = send_all(s.talk, &task, sizeof(task));
  std::string text;
  for (char kind = 0; good;) {
    if (limited && !s.hears_in_time(until_s, until_ns)) {
      s.end();
      return Error{fmt::format("it was not done after {:g} s of processor time", s.limits.task_s)};
    }
    good = receive_message(s.talk, kind, text);
    if (!good) break;
    if (kind == kAnswer) return text;
    if (kind == kFailed) return error_of(text);
    const ChildJson said = ChildJson::parse(text, nullptr, false);
    if (said.is_object()) progress.report(said.value("what", ""), said.value("fraction", -1.0));
  }
  return s.how_it_ended();
}

bool Child::is_apart() const {
  return state_->talk >= 0;
}
bool Child::alive() const {
  return state_->talk < 0 || state_->pid > 0;
}

}  // namespace palpate::experiments

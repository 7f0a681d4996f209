#include "experiments/run/seat.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include "toolkit/core/at_stop.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/fork_ready.h"

namespace palpate::experiments {
namespace {

using Json = nlohmann::json;

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

std::string error_text(const Error& error) {
  return Json{{"what", error.what},
              {"remedy", error.remedy},
              {"file", error.file},
              {"line", error.line},
              {"gave_up", error.gave_up}}
      .dump(-1, ' ', false, Json::error_handler_t::replace);
}

Error error_of(const std::string& text) {
  const Json j = Json::parse(text, nullptr, false);
  if (!j.is_object()) return Error{"the renderer's process answered what is no answer", {}, {}, 0};
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
    const std::string text =
        Json{{"what", what_}, {"fraction", fraction}}.dump(-1, ' ', false, Json::error_handler_t::replace);
    static_cast<void>(send_message(fd_, kProgress, text));
  }

 private:
  int fd_;
  std::string what_;
  std::int64_t last_ns_ = 0;
};

/// Memory that a forked process shares with this one.
class SharedMemory {
 public:
  explicit SharedMemory(std::size_t bytes) : bytes_(bytes) {
    data_ = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (data_ == MAP_FAILED) throw std::bad_alloc();
  }
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  ~SharedMemory() { ::munmap(data_, bytes_); }
  /// The next `count` of them, made anew.
  template <class T>
  std::span<T> take(std::size_t count) {
    used_ = (used_ + alignof(T) - 1) / alignof(T) * alignof(T);
    T* first = reinterpret_cast<T*>(static_cast<std::byte*>(data_) + used_);
    used_ += count * sizeof(T);
    std::uninitialized_default_construct_n(first, count);
    return {first, count};
  }
  static std::size_t bytes_for(std::size_t frames) {
    constexpr std::size_t kSlack = 1024;  // alignment
    return frames * (sizeof(render::Frame) + 1 + sizeof(trace::StretchTime) + sizeof(std::uint32_t)) +
           2 * sizeof(trace::PacedStatistics) + kSlack;
  }

 private:
  void* data_;
  std::size_t bytes_, used_ = 0;
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
  static_cast<void>(run_stop_actions());
  ::_exit(1);
}

[[noreturn]] void serve(int talk, int life, Work& work) {
  std::thread([life] { end_with(life); }).detach();
  FarProgress progress(talk);
  for (char task = 0; receive_all(talk, &task, 1);) {
    const Result<std::string> answer = work(static_cast<Task>(task), progress);
    if (!send_message(talk, answer ? kAnswer : kFailed, answer ? *answer : error_text(answer.error()))) break;
  }
  ::_exit(0);  // what this process has of the other one is not its to end
}

}  // namespace

struct Seat::State {
  SharedMemory memory;
  Answers answers;
  Work work;
  pid_t pid = 0;  ///< 0: in this process
  int talk = -1, life = -1;
  AtStop at_stop;

  State(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
        const RunOptions& options)
      : memory(SharedMemory::bytes_for(stage.path.size())),
        answers{memory.take<render::Frame>(stage.path.size()), memory.take<std::uint8_t>(stage.path.size()),
                memory.take<trace::StretchTime>(stage.path.size()),
                memory.take<std::uint32_t>(stage.path.size()),
                std::span<trace::PacedStatistics, 2>(memory.take<trace::PacedStatistics>(2))},
        work(stage, request, registry, options, answers) {}

  void fork_off();
  void let_go() noexcept;
  int wait_for_end() noexcept {
    int status = 0;
    while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    return status;
  }
};

void Seat::State::fork_off() {
  int talks[2], lives[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, talks) != 0) return;
  if (::pipe2(lives, O_CLOEXEC) != 0) {
    ::close(talks[0]);
    ::close(talks[1]);
    return;
  }
  auto hold = hold_stop();
  std::fflush(nullptr);  // or both processes would write it
  pid = ::fork();
  if (pid == 0) {
    forget_stop_actions();
    // Ctrl-C on the terminal reaches all processes: the other one ends this one.
    std::signal(SIGINT, SIG_IGN);
    std::signal(SIGTERM, SIG_DFL);
    for (const int end : our_ends()) ::close(end);
    ::close(talks[0]);
    ::close(lives[1]);
    static_cast<void>(hold.release());  // forgotten with the actions
    serve(talks[1], lives[0], work);
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
  at_stop = AtStop([this] {
    let_go();
    return std::string();
  });
}

void Seat::State::let_go() noexcept {
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

Seat::Seat(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
           const RunOptions& options, bool apart)
    : state_(std::make_unique<State>(stage, request, registry, options)) {
  if (apart && end_waiting_threads()) state_->fork_off();
}

Seat::~Seat() {
  state_->at_stop.drop();
  if (state_->talk < 0) return;
  our_ends().erase(state_->talk);
  our_ends().erase(state_->life);
  ::close(state_->talk);
  state_->let_go();
}

Result<std::string> Seat::ask(Task task, Progress& progress) {
  State& s = *state_;
  if (s.talk < 0) return s.work(task, progress);
  const char asked = static_cast<char>(task);
  bool good = send_all(s.talk, &asked, 1);
  std::string text;
  for (char kind = 0; good && (good = receive_message(s.talk, kind, text));) {
    if (kind == kAnswer) return text;
    if (kind == kFailed) return error_of(text);
    const Json said = Json::parse(text, nullptr, false);
    if (said.is_object()) progress.report(said.value("what", ""), said.value("fraction", -1.0));
  }
  const int status = s.wait_for_end();
  s.pid = 0;
  return Error{WIFSIGNALED(status) ? fmt::format("its process was ended by signal {} ({})", WTERMSIG(status),
                                                 ::strsignal(WTERMSIG(status)))
                                   : fmt::format("its process ended with status {}", WEXITSTATUS(status)),
               "take a smaller model, or report a crash",
               {},
               0};
}

const Answers& Seat::answers() const {
  return state_->answers;
}
bool Seat::is_apart() const {
  return state_->talk >= 0;
}

bool has_room() {
  constexpr double kLeastFree = 1.0 / 3.0;
  std::ifstream file("/proc/meminfo");
  double total = 0.0, available = 0.0;
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("MemTotal:", 0) == 0)
      total = std::strtod(line.c_str() + std::strlen("MemTotal:"), nullptr);
    if (line.rfind("MemAvailable:", 0) == 0)
      available = std::strtod(line.c_str() + std::strlen("MemAvailable:"), nullptr);
  }
  return !(total > 0.0) || available > kLeastFree * total;
}

}  // namespace palpate::experiments

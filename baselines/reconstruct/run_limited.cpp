#include "baselines/reconstruct/run_limited.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>

#include "baselines/reconstruct/worker_protocol.h"
#include "toolkit/core/at_stop.h"
#include "toolkit/core/clock.h"

extern char** environ;

namespace palpate::baselines {
namespace {

namespace fs = std::filesystem;

constexpr const char* kProgram = "palpate-reconstruct";
constexpr int kPollMs = 50;  // how soon a limit or a wish to stop is noticed
constexpr double kGigabyte = 1e9, kMsPerS = 1e3;
constexpr std::size_t kKeptOutput = 4096;  // the last words of a library are what counts
constexpr std::uint64_t kLongestMessage = std::uint64_t{1} << 37;  // a mesh of a billion triangles is shorter
constexpr std::size_t kPiece = std::size_t{1} << 18;

Result<std::string> find_program() {
  std::vector<fs::path> places;
  if (const char* given = std::getenv("PALPATE_RECONSTRUCT"); given != nullptr && *given != '\0') {
    places.emplace_back(given);
  } else {
    std::error_code code;
    if (const fs::path own = fs::read_symlink("/proc/self/exe", code); !code)
      places.push_back(own.parent_path() / kProgram);
    places.push_back(fs::path(PALPATE_BUILT_PROGRAMS) / kProgram);
    places.push_back(fs::path(PALPATE_INSTALLED_PROGRAMS) / kProgram);
  }
  for (const fs::path& place : places)
    if (::access(place.c_str(), X_OK) == 0) return place.string();
  return Error{fmt::format("the program {} is not there, which reconstructs within limits", kProgram),
               "install all of Palpate, or set PALPATE_RECONSTRUCT to where it is", places.front().string(),
               0};
}

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) noexcept : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() { close(); }
  void close() noexcept {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }
  void set(int fd) noexcept {
    close();
    fd_ = fd;
  }
  [[nodiscard]] int get() const noexcept { return fd_; }

 private:
  int fd_;
};

/// The process and its two ends. Whatever happens, it is gone with this.
class Worker {
 public:
  Worker() = default;
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;
  ~Worker() { end(); }

  Status start(const std::string& program, const std::vector<std::string>& arguments) {
    std::array<int, 2> socket{-1, -1}, output{-1, -1};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, socket.data()) != 0) return cannot_start(errno);
    socket_.set(socket[0]);
    const Descriptor its_socket(socket[1]);
    if (::pipe2(output.data(), O_CLOEXEC) != 0) return cannot_start(errno);
    output_.set(output[0]);
    const Descriptor its_output(output[1]);
    ::fcntl(socket_.get(), F_SETFL, O_NONBLOCK);
    std::vector<char*> argv = {const_cast<char*>(program.c_str())};
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, its_socket.get(), STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, its_output.get(), STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, its_output.get(), STDERR_FILENO);
    // A group of its own: Ctrl-C on the terminal asks us, and would look like a crash of the worker.
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    const auto hold = hold_stop();
    const int code = ::posix_spawn(&pid_, program.c_str(), &actions, &attributes, argv.data(), environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    if (code != 0) {
      pid_ = 0;
      return cannot_start(code);
    }
    at_stop_ = AtStop([group = -pid_] {
      ::kill(group, SIGKILL);
      return std::string();
    });
    return Done{};
  }
  /// Ends it and returns how it ended.
  int end() noexcept {
    if (pid_ == 0) return status_;
    at_stop_.drop();
    ::kill(-pid_, SIGKILL);  // to one that has ended by itself this does nothing
    while (::waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
    }
    pid_ = 0;
    return status_;
  }
  [[nodiscard]] int socket() const noexcept { return socket_.get(); }
  [[nodiscard]] int output() const noexcept { return output_.get(); }

 private:
  static Error cannot_start(int code) {
    return Error{fmt::format("{} could not be started: {}", kProgram, std::strerror(code)),
                 "close other programs",
                 {},
                 0};
  }
  pid_t pid_ = 0;
  int status_ = 0;
  AtStop at_stop_;
  Descriptor socket_, output_;
};

/// The talk with one worker, until its last message, its end, or a limit.
class Talk {
 public:
  Talk(const Worker& worker, std::string cloud, const Limits& limits, std::string method, Progress& progress)
      : worker_(worker),
        to_send_(std::move(cloud)),
        limits_(limits),
        method_(std::move(method)),
        progress_(progress) {}

  /// The answer; nothing where the worker ended without one.
  std::optional<Result<Reconstruction>> run() {
    bool open = true;
    while (open) {
      const bool sending = sent_ < to_send_.size();
      std::array<pollfd, 2> watched = {
          pollfd{worker_.socket(), static_cast<short>(sending ? POLLIN | POLLOUT : POLLIN), 0},
          pollfd{worker_.output(), POLLIN, 0}};
      ::poll(watched.data(), output_open_ ? 2 : 1, wait_ms());
      if (sending && (watched[0].revents & POLLOUT) != 0) send();
      if ((watched[0].revents & (POLLIN | POLLHUP | POLLERR)) != 0) open = receive();
      if (output_open_ && watched[1].revents != 0) keep_output();
      if (auto answer = next_answer()) return answer;
      if (progress_.cancelled()) return Error{method_ + " was stopped", {}, {}, 0};
      if (limits_.time_s > 0.0 && watch_.ms() > limits_.time_s * kMsPerS) return too_slow();
      tell();
    }
    while (output_open_) keep_output();  // its last words
    return std::nullopt;
  }
  /// The last line that it printed, for an error.
  [[nodiscard]] std::string last_line() const {
    std::string text = output_;
    while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
    const std::size_t start = text.rfind('\n');
    return start == std::string::npos ? text : text.substr(start + 1);
  }

 private:
  int wait_ms() const {
    if (limits_.time_s <= 0.0) return kPollMs;
    return static_cast<int>(std::clamp(limits_.time_s * kMsPerS - watch_.ms() + 1.0, 0.0, double{kPollMs}));
  }
  void send() {
    const ssize_t n = ::send(worker_.socket(), to_send_.data() + sent_,
                             std::min(to_send_.size() - sent_, kPiece), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n > 0) sent_ += static_cast<std::size_t>(n);
  }
  /// False at the end of what it says.
  bool receive() {
    const std::size_t before = received_.size();
    received_.resize(before + kPiece);
    const ssize_t n = ::recv(worker_.socket(), received_.data() + before, kPiece, MSG_DONTWAIT);
    received_.resize(before + static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
    return n > 0 || (n < 0 && (errno == EAGAIN || errno == EINTR));
  }
  void keep_output() {
    std::array<char, kKeptOutput> piece;
    const ssize_t n = ::read(worker_.output(), piece.data(), piece.size());
    if (n < 0 && errno == EINTR) return;
    if (n <= 0) {
      output_open_ = false;
      return;
    }
    output_.append(piece.data(), static_cast<std::size_t>(n));
    if (output_.size() > 2 * kKeptOutput) output_.erase(0, output_.size() - kKeptOutput);
  }
  std::optional<Result<Reconstruction>> next_answer() {
    while (received_.size() >= kMessageHead) {
      std::uint64_t size = 0;
      std::memcpy(&size, received_.data() + 1, sizeof size);
      if (size > kLongestMessage)
        return Error{method_ + " gave an answer that cannot be read", "install all of Palpate anew", {}, 0};
      if (received_.size() - kMessageHead < size) {
        if (received_.capacity() < kMessageHead + size + kPiece)
          received_.reserve(kMessageHead + size + kPiece);
        return std::nullopt;
      }
      ByteReader body(std::string_view(received_).substr(kMessageHead, size));
      switch (static_cast<WorkerMessage>(received_[0])) {
        case WorkerMessage::kResult:
          return read_reconstruction(body);
        case WorkerMessage::kError:
          return read_error(body);
        case WorkerMessage::kNoMemory:
          return too_large();
        case WorkerMessage::kProgress:
          phase_ = received_.substr(kMessageHead, size);
          break;
      }
      received_.erase(0, kMessageHead + size);
    }
    return std::nullopt;
  }
  void tell() {
    const double s = watch_.ms() / kMsPerS;
    progress_.report(limits_.time_s > 0.0
                         ? fmt::format("{}: {}, {:.0f} of at most {:g} s", method_, phase_, s, limits_.time_s)
                         : fmt::format("{}: {}, {:.0f} s", method_, phase_, s),
                     -1.0);
  }
  Error too_slow() const {
    Error error{fmt::format("{} did not finish in {:g} s (it was at: {})", method_, limits_.time_s, phase_),
                "allow more time, or use fewer points or another reconstruction",
                {},
                0};
    error.gave_up = true;
    return error;
  }
  Error too_large() const {
    Error error{fmt::format("{} needed more than {:.3g} GB (it was at: {})", method_,
                            static_cast<double>(memory_limit(limits_)) / kGigabyte, phase_),
                "allow more memory, or use fewer points or another reconstruction",
                {},
                0};
    error.gave_up = true;
    return error;
  }

  const Worker& worker_;
  std::string to_send_;
  std::size_t sent_ = 0;
  Limits limits_;
  std::string method_;
  Progress& progress_;
  std::string received_, output_, phase_ = "starting";
  bool output_open_ = true;
  Stopwatch watch_;
};

}  // namespace

std::size_t memory_limit(const Limits& limits) {
  if (limits.memory_bytes > 0) return limits.memory_bytes;
  const auto pages = static_cast<std::size_t>(std::max(::sysconf(_SC_PHYS_PAGES), 1L));
  return pages / 4 * 3 * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

Result<Reconstruction> run_limited(const Method& method, const cloud::Cloud& cloud, const Options& options,
                                   const Limits& limits, int threads, Progress& progress) {
  const Result<std::string> program = find_program();
  if (!program) return program.error();
  if (progress.cancelled()) return Error{method.name + " was stopped", {}, {}, 0};
  std::vector<std::string> arguments = {method.name, std::to_string(threads),
                                        std::to_string(memory_limit(limits)), std::to_string(::getpid())};
  for (const auto& [key, value] : options.all()) arguments.push_back(key + "=" + value);
  ByteWriter body, message;
  write(body, cloud);
  message.text(body.bytes());
  Worker worker;
  if (const Status started = worker.start(*program, arguments); !started) return started.error();
  Talk talk(worker, std::move(message).take(), limits, method.name, progress);
  if (auto answer = talk.run()) return *std::move(answer);
  const int status = worker.end();
  Error error{fmt::format("{} ended without an answer", method.name),
              "take other options or another reconstruction",
              {},
              0};
  if (WIFSIGNALED(status))
    error.what = fmt::format("{} crashed ({})", method.name, ::strsignal(WTERMSIG(status)));
  if (const std::string last = talk.last_line(); !last.empty()) error.what += ": " + last;
  return error;
}

}  // namespace palpate::baselines

#include "toolkit/core/process.h"

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
#include <cstdlib>
#include <cstring>

#include <palpate/clock.h>
#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"

extern char** environ;

namespace palpate {
namespace {

constexpr std::size_t kKeptOutput = std::size_t{1} << 20;
constexpr std::size_t kPiece = std::size_t{1} << 18;
constexpr std::size_t kLongestLine = 4096;
constexpr int kPollMs = 50;  // polling interval: smooth for a bar, negligible load
constexpr double kMsPerS = 1e3;

/// Two ends: ours, and the program's.
struct Ends {
  Descriptor ours, its;
  bool open_pipe() {
    std::array<int, 2> fd{};
    if (::pipe2(fd.data(), O_CLOEXEC) != 0) return false;
    ours = Descriptor(fd[0]);
    its = Descriptor(fd[1]);
    return true;
  }
  bool open_socket() {
    std::array<int, 2> fd{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fd.data()) != 0) return false;
    ours = Descriptor(fd[0]);
    its = Descriptor(fd[1]);
    ::fcntl(ours.get(), F_SETFL, O_NONBLOCK);
    return true;
  }
};

Error cannot_start(const std::string& program, int code) {
  const bool missing = code == ENOENT || code == EACCES;
  return Error{fmt::format("the program '{}' could not be started: {}", program, std::strerror(code)),
               missing ? "install it or put it on PATH" : "close other programs"};
}

/// Prefixes a file size limit, effective from the first instruction (util-linux, always on Debian). No core
/// file, which the signal would leave.
std::vector<std::string> with_file_limit(const std::vector<std::string>& arguments, std::uint64_t bytes) {
  std::vector<std::string> limited = {"prlimit", fmt::format("--fsize={}", bytes), "--core=0"};
  limited.insert(limited.end(), arguments.begin(), arguments.end());
  return limited;
}

/// A running program, ended with this object.
class Child {
 public:
  explicit Child(const ProcessOptions& options) : options_(options) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (!ended_) end();
  }

  Status start(const std::vector<std::string>& arguments);
  /// Exchanges data, keeps output and calls tick() until its end or a limit.
  ProcessOutcome follow();

 private:
  void wait_for_news();
  void send();
  void listen();
  void keep(Descriptor& from, std::string& into);
  void note_end();
  void keep_limits();
  void end() noexcept;

  const ProcessOptions& options_;
  pid_t pid_ = 0;
  int status_ = 0;
  bool ended_ = true;
  StopCallback stop_callback_;
  Ends talk_, out_, err_;
  std::size_t sent_ = 0;
  std::string received_, line_;
  ProcessOutcome outcome_;
  bool quiet_ = false;  ///< the last poll brought nothing
  Stopwatch watch_;
};

Status Child::start(const std::vector<std::string>& arguments) {
  if (!out_.open_pipe() || !err_.open_pipe() || (options_.talk != nullptr && !talk_.open_socket()))
    return cannot_start(arguments[0], errno);
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (!options_.folder.empty()) posix_spawn_file_actions_addchdir_np(&actions, options_.folder.c_str());
  if (options_.talk != nullptr)
    posix_spawn_file_actions_adddup2(&actions, talk_.its.get(), STDIN_FILENO);
  else
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out_.its.get(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err_.its.get(), STDERR_FILENO);
  // Its own process group: it is ended with its children, and Ctrl-C reaches only us.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  const auto hold = block_stop();
  const int code = ::posix_spawnp(&pid_, argv[0], &actions, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  for (Ends* ends : {&talk_, &out_, &err_}) ends->its.close();
  if (code != 0) return cannot_start(arguments[0], code);
  ended_ = false;
  stop_callback_ = StopCallback([group = -pid_] {
    ::kill(group, SIGKILL);
    return std::string();
  });
  return Done{};
}

ProcessOutcome Child::follow() {
  // A grandchild may keep the pipes open; one poll without data then suffices.
  while (!ended_ || (!quiet_ && (talk_.ours.is_open() || out_.ours.is_open() || err_.ours.is_open()))) {
    wait_for_news();
    note_end();
    keep_limits();
  }
  outcome_.signal = WIFSIGNALED(status_) ? WTERMSIG(status_) : 0;
  outcome_.exit_code = outcome_.signal == 0 ? WEXITSTATUS(status_) : kSignalBase + outcome_.signal;
  while (!outcome_.last_line.empty() && outcome_.last_line.back() == ' ') outcome_.last_line.pop_back();
  return std::move(outcome_);
}

void Child::wait_for_news() {
  const bool sending = options_.talk != nullptr && sent_ < options_.talk->to_send.size();
  // poll() ignores a negative descriptor.
  std::array<pollfd, 3> watched = {
      pollfd{talk_.ours.get(), static_cast<short>(sending ? POLLIN | POLLOUT : POLLIN), 0},
      pollfd{out_.ours.get(), POLLIN, 0}, pollfd{err_.ours.get(), POLLIN, 0}};
  double wait_ms = kPollMs;
  if (options_.time_limit_s > 0.0)
    wait_ms = std::clamp(options_.time_limit_s * kMsPerS - watch_.ms() + 1.0, 1.0, wait_ms);
  quiet_ = ::poll(watched.data(), watched.size(), static_cast<int>(wait_ms)) <= 0;
  if ((watched[0].revents & POLLOUT) != 0) send();
  if ((watched[0].revents & (POLLIN | POLLHUP | POLLERR)) != 0) listen();
  if (watched[1].revents != 0) keep(out_.ours, outcome_.out);
  if (watched[2].revents != 0) keep(err_.ours, outcome_.err);
}

void Child::send() {
  const std::string& text = options_.talk->to_send;
  const ssize_t n = ::send(talk_.ours.get(), text.data() + sent_, std::min(text.size() - sent_, kPiece),
                           MSG_NOSIGNAL | MSG_DONTWAIT);
  if (n > 0) sent_ += static_cast<std::size_t>(n);
}

void Child::listen() {
  const std::size_t before = received_.size();
  received_.resize(before + kPiece);
  const ssize_t n = ::recv(talk_.ours.get(), received_.data() + before, kPiece, MSG_DONTWAIT);
  const bool again = n < 0 && (errno == EAGAIN || errno == EINTR);
  received_.resize(before + static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
  if (n <= 0 && !again) return talk_.ours.close();
  if (n <= 0 || options_.talk->hear(received_)) return;
  outcome_.stopped = true;
  talk_.ours.close();
  if (!ended_) end();
}

void Child::keep(Descriptor& from, std::string& into) {
  std::array<char, kLongestLine> piece;
  const ssize_t got = ::read(from.get(), piece.data(), piece.size());
  if (got < 0 && (errno == EINTR || errno == EAGAIN)) return;
  if (got <= 0) return from.close();
  const auto size = static_cast<std::size_t>(got);
  if (into.size() < kKeptOutput) into.append(piece.data(), std::min(size, kKeptOutput - into.size()));
  for (const char c : std::string_view(piece.data(), size)) {
    if (c != '\n') {
      if (line_.size() < kLongestLine) line_ += c;
      continue;
    }
    if (!line_.empty()) outcome_.last_line = std::move(line_);
    line_.clear();
  }
  if (!line_.empty()) outcome_.last_line = line_;
}

void Child::note_end() {
  if (ended_) return;
  // Not reaped until its group is ended, so its id stays valid.
  siginfo_t info{};
  if (::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) != 0 ||
      info.si_pid != pid_)
    return;
  if (outcome_.timed_out) return end();
  ended_ = true;
  stop_callback_.drop();
  ::waitpid(pid_, &status_, 0);
}

void Child::keep_limits() {
  if (options_.tick && !options_.tick() && !ended_) {
    outcome_.stopped = true;
    talk_.ours.close();
    return end();
  }
  const double elapsed_s = watch_.ms() / kMsPerS;
  if (ended_ || options_.time_limit_s <= 0.0 || elapsed_s < options_.time_limit_s) return;
  outcome_.timed_out = true;
  if (elapsed_s < options_.time_limit_s + options_.grace_s)
    ::kill(-pid_, SIGTERM);
  else
    end();
}

void Child::end() noexcept {
  stop_callback_.drop();
  ::kill(-pid_, SIGKILL);  // no effect if it has ended
  while (::waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
  }
  ended_ = true;
}

}  // namespace

Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments, const ProcessOptions& options) {
  Child child(options);
  PALPATE_TRY(child.start(options.file_limit_bytes > 0 ? with_file_limit(arguments, options.file_limit_bytes)
                                                       : arguments));
  return child.follow();
}

bool program_exists(const std::string& name) {
  const char* path = std::getenv("PATH");
  if (path == nullptr) return false;
  const std::vector<std::string> folders = split_list(path, ':');
  return std::any_of(folders.begin(), folders.end(), [&](const std::string& folder) {
    return ::access((folder + "/" + name).c_str(), X_OK) == 0;
  });
}

}  // namespace palpate

#include "experiments/data/process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdlib>
#include <cstring>

#include "toolkit/core/at_stop.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/options.h"

extern char** environ;

namespace palpate::experiments {
namespace {

constexpr std::size_t kKeptOutput = 1u << 20;
constexpr int kPollMs = 100;     // ten ticks a second: smooth for a bar, nothing for a processor
constexpr double kGraceS = 2.0;  // between asking a program to end and ending it

struct Pipe {
  std::array<int, 2> fd{-1, -1};
  Pipe() = default;
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  ~Pipe() {
    close_end(0);
    close_end(1);
  }
  void close_end(std::size_t end) {
    if (fd[end] >= 0) ::close(fd[end]);
    fd[end] = -1;
  }
};

/// Reads what is there. False at the end of the stream.
bool drain(int fd, std::string& into) {
  std::array<char, 4096> piece;
  const ssize_t got = ::read(fd, piece.data(), piece.size());
  if (got == 0) return false;
  if (got < 0) return errno == EINTR || errno == EAGAIN;
  const auto size = static_cast<std::size_t>(got);
  if (into.size() < kKeptOutput) into.append(piece.data(), std::min(size, kKeptOutput - into.size()));
  return true;
}

Result<pid_t> spawn(const std::vector<std::string>& arguments, const std::string& folder, Pipe& out,
                    Pipe& err) {
  if (::pipe2(out.fd.data(), O_CLOEXEC) != 0 || ::pipe2(err.fd.data(), O_CLOEXEC) != 0)
    return Error{"no pipe could be opened", "close other programs", {}, 0};
  std::vector<char*> argv;
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (!folder.empty()) posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out.fd[1], STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.fd[1], STDERR_FILENO);
  // A group of its own: it is ended with all that it started, and Ctrl-C on the terminal asks us, not it.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  pid_t pid = 0;
  const int code = ::posix_spawnp(&pid, argv[0], &actions, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  out.close_end(1);
  err.close_end(1);
  if (code != 0)
    return Error{fmt::format("the program '{}' could not be started: {}", arguments[0], std::strerror(code)),
                 "install it or put it on PATH",
                 {},
                 0};
  return pid;
}

/// Whether it has ended. It stays to be waited for, so that its number means nothing else yet.
bool has_ended(pid_t pid) {
  siginfo_t info{};
  return ::waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
         info.si_pid == pid;
}

/// The command that runs `arguments` with a limit on the files that it writes, from its first instruction on
/// (util-linux, which every Debian has). No core: the signal would leave one.
std::vector<std::string> with_file_limit(const std::vector<std::string>& arguments, std::uint64_t bytes) {
  std::vector<std::string> limited = {"prlimit", fmt::format("--fsize={}", bytes), "--core=0"};
  limited.insert(limited.end(), arguments.begin(), arguments.end());
  return limited;
}

}  // namespace

Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments, double time_limit_s,
                                   const std::function<void()>& tick, const std::string& folder,
                                   std::uint64_t file_limit_bytes) {
  Pipe out, err;
  auto hold = hold_stop();
  const Result<pid_t> pid = spawn(
      file_limit_bytes > 0 ? with_file_limit(arguments, file_limit_bytes) : arguments, folder, out, err);
  if (!pid) return pid.error();
  AtStop at_stop([group = -*pid] {
    ::kill(group, SIGKILL);
    return std::string();
  });
  hold.unlock();
  ProcessOutcome outcome;
  Stopwatch watch;
  int status = 0;
  bool ended = false;
  while (!ended || out.fd[0] >= 0 || err.fd[0] >= 0) {
    // poll() ignores a negative descriptor. A grandchild may hold the pipes open after the program ended:
    // then one empty poll is enough.
    std::array<pollfd, 2> watched = {pollfd{out.fd[0], POLLIN, 0}, pollfd{err.fd[0], POLLIN, 0}};
    const int ready = ::poll(watched.data(), watched.size(), kPollMs);
    if (ready > 0) {
      if (watched[0].revents != 0 && !drain(out.fd[0], outcome.out)) out.close_end(0);
      if (watched[1].revents != 0 && !drain(err.fd[0], outcome.err)) err.close_end(0);
    } else if (ended) {
      break;
    }
    if (!ended && has_ended(*pid)) {
      ended = true;
      at_stop.drop();
      if (outcome.timed_out) ::kill(-*pid, SIGKILL);  // what it left behind
      ::waitpid(*pid, &status, 0);
    }
    if (tick) tick();
    const double elapsed_s = watch.ms() * 1e-3;
    if (!ended && elapsed_s > time_limit_s) {
      outcome.timed_out = true;
      ::kill(-*pid, elapsed_s > time_limit_s + kGraceS ? SIGKILL : SIGTERM);
    }
  }
  outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : kSignalBase + WTERMSIG(status);
  return outcome;
}

bool program_exists(const std::string& name) {
  const char* path = std::getenv("PATH");
  if (path == nullptr) return false;
  for (const std::string& folder : split_list(path, ':'))
    if (::access((folder + "/" + name).c_str(), X_OK) == 0) return true;
  return false;
}

}  // namespace palpate::experiments

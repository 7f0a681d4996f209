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

#include "toolkit/core/clock.h"
#include "toolkit/core/options.h"

extern char** environ;

namespace palpate::experiments {
namespace {

constexpr std::size_t kKeptOutput = 1u << 20;
constexpr int kPollMs = 100;      // ten ticks a second: smooth for a bar, nothing for a processor
constexpr double kGraceS = 2.0;   // between asking a program to end and ending it
constexpr int kSignalBase = 128;  // the shells' convention for "ended by a signal"

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
  pid_t pid = 0;
  const int code = ::posix_spawnp(&pid, argv[0], &actions, nullptr, argv.data(), environ);
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

}  // namespace

Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments, double time_limit_s,
                                   const std::function<void()>& tick, const std::string& folder) {
  Pipe out, err;
  const Result<pid_t> pid = spawn(arguments, folder, out, err);
  if (!pid) return pid.error();
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
    if (!ended) ended = ::waitpid(*pid, &status, WNOHANG) == *pid;
    if (tick) tick();
    const double elapsed_s = watch.ms() * 1e-3;
    if (!ended && elapsed_s > time_limit_s) {
      outcome.timed_out = true;
      ::kill(*pid, elapsed_s > time_limit_s + kGraceS ? SIGKILL : SIGTERM);
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

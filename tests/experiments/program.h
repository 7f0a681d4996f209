// Runs the palpate program as a user does.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "tests/in_folder.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {

/// Sets an environment variable for the lifetime of the object; null removes it.
class Environment {
 public:
  Environment(std::string name, const char* value) : name_(std::move(name)) {
    if (const char* old = std::getenv(name_.c_str())) old_ = old, had_ = true;
    value != nullptr ? ::setenv(name_.c_str(), value, 1) : ::unsetenv(name_.c_str());
  }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;
  ~Environment() { had_ ? ::setenv(name_.c_str(), old_.c_str(), 1) : ::unsetenv(name_.c_str()); }

 private:
  std::string name_, old_;
  bool had_ = false;
};

inline std::string file_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

inline void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

#ifdef PALPATE_PROGRAM
/// The program running, in a group of its own, its output in files, or in `out_fd` where that is given.
class Started {
 public:
  Started(const std::filesystem::path& folder, std::vector<std::string> arguments, int out_fd = -1)
      : out_(folder / "started.out"), err_(folder / "started.err") {
    arguments.insert(arguments.begin(), PALPATE_PROGRAM);
    std::vector<char*> argv;
    for (std::string& a : arguments) argv.push_back(a.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    constexpr int kMode = 0644;
    for (const auto& [fd, file] : {std::pair{STDOUT_FILENO, &out_}, std::pair{STDERR_FILENO, &err_}})
      posix_spawn_file_actions_addopen(&actions, fd, file->c_str(), O_CREAT | O_TRUNC | O_WRONLY, kMode);
    if (out_fd >= 0) posix_spawn_file_actions_adddup2(&actions, out_fd, STDOUT_FILENO);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    if (::posix_spawn(&pid_, argv[0], &actions, &attributes, argv.data(), environ) != 0)
      ADD_FAILURE() << "could not be started";
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
  }
  Started(const Started&) = delete;
  Started& operator=(const Started&) = delete;
  ~Started() {
    if (pid_ == 0) return;
    ::kill(-pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }

  /// Whether `seen` came true while it ran.
  bool wait_for(const std::function<bool()>& seen) {
    while (!seen()) {
      if (ended()) return seen();
      ::usleep(kPollUs);
    }
    return true;
  }
  /// Until it knows what to do with SIGINT: on a busy machine its libraries take a second to load.
  void wait_for_signals() {
    wait_for([this] {
      std::ifstream status("/proc/" + std::to_string(pid_) + "/status");
      for (std::string line; std::getline(status, line);)
        if (line.starts_with("SigCgt:") || line.starts_with("SigBlk:"))
          if ((std::stoull(line.substr(7), nullptr, 16) >> (SIGINT - 1) & 1u) != 0) return true;
      return false;
    });
  }
  void send(int signal) const { ::kill(pid_, signal); }
  /// To it and all of its group, as Ctrl-C on a terminal does.
  void send_group(int signal) const { ::kill(-pid_, signal); }
  /// How it ended, 128 + signal where one killed it. One that goes on and on is killed, and fails the test.
  int end() {
    constexpr int kPatienceS = 60;
    constexpr int kPolls = kPatienceS * 1'000'000 / kPollUs;
    for (int i = 0; i < kPolls && !ended(); ++i) ::usleep(kPollUs);
    if (!ended()) {
      ADD_FAILURE() << "it did not end";
      ::kill(-pid_, SIGKILL);
    }
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = 0;
    killed_ = WIFSIGNALED(status);
    return killed_ ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  }
  [[nodiscard]] bool killed() const { return killed_; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::string out() const { return file_text(out_); }
  [[nodiscard]] std::string err() const { return file_text(err_); }

 private:
  static constexpr int kPollUs = 2000;
  [[nodiscard]] bool ended() const {
    siginfo_t info{};
    return ::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           info.si_pid == pid_;
  }
  std::filesystem::path out_, err_;
  pid_t pid_ = 0;
  bool killed_ = false;
};

inline ProcessOutcome palpate_command(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), PALPATE_PROGRAM);
  constexpr double kLimitS = 120.0;
  Result<ProcessOutcome> run = run_process(arguments, {.time_limit_s = kLimitS});
  if (!run) {
    ADD_FAILURE() << run.error().message();
    return {};
  }
  EXPECT_FALSE(run->timed_out);
  return *std::move(run);
}
#endif

}  // namespace palpate::experiments

// Runs the palpate command as a user does.
#pragma once

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {

using test::value_of;
using testing::HasSubstr, testing::Not;

/// Scenes and a path on which a command is done in a moment.
inline constexpr const char* kTinyWaves =
    "sinusoid:points=2601:extent_mm=20:wavelength_mm=20:amplitude_mm=1:seed=1";
inline constexpr const char* kSmallWaves =
    "sinusoid:points=2601:extent_mm=40:wavelength_mm=20:amplitude_mm=1";
inline constexpr const char* kTinyWeave =
    "weave:frames=1500:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

/// A text that holds all of these; one that holds none.
template <class... Texts>
auto HasAll(const Texts&... texts) {
  return testing::AllOf(HasSubstr(texts)...);
}
template <class... Texts>
auto HasNone(const Texts&... texts) {
  return Not(testing::AnyOf(HasSubstr(texts)...));
}

/// Whether a session under real time ended as asked: with status 0, or with 1 for no other fault than that a
/// busy machine gave its loop no time. `document`: its live.json.
inline testing::AssertionResult ended_well(int status, const std::filesystem::path& document) {
  if (status == 0) return testing::AssertionSuccess();
  if (status != 1) return testing::AssertionFailure() << "exit status " << status;
  const auto json = nlohmann::json::parse(file_text(document), nullptr, false);
  if (!json.contains("fault_names")) return testing::AssertionFailure() << "no document of the session";
  for (const std::string fault : json["fault_names"])
    if (fault.find("the servo loop") == std::string::npos) return testing::AssertionFailure() << fault;
  return testing::AssertionSuccess();
}
/// How often a text has this part.
inline std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

/// What `run` returns, and what it writes to both standard streams.
template <class Run>
ProcessOutcome captured(Run&& run) {
  ProcessOutcome outcome;
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  outcome.exit_code = run();
  outcome.out = testing::internal::GetCapturedStdout();
  outcome.err = testing::internal::GetCapturedStderr();
  return outcome;
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

/// Runs a command line in this process, through the entry function of the program, as long as two minutes.
[[nodiscard]] ProcessOutcome palpate_command(std::vector<std::string> arguments);
/// Runs the program itself: for what starts itself again, or ends at once.
[[nodiscard]] ProcessOutcome palpate_process(std::vector<std::string> arguments);

/// Command lines in a folder of their own, what they leave there, and what they must answer.
///
/// A line is given in parts. A literal is split at its spaces, and its '@' stands for the folder; a string is
/// one word; a list is appended.
class OnCommandLine : public InFolder {
 protected:
  using Words = std::vector<std::string>;
  template <class... Parts>
  [[nodiscard]] Words words(const Parts&... parts) const {
    Words all;
    (add(all, parts), ...);
    return all;
  }
  template <class... Parts>
  ProcessOutcome palpate(const Parts&... parts) const {
    return run_line(words(parts...));
  }
  /// The line must end with exit status 0.
  template <class... Parts>
  ProcessOutcome succeeds(const Parts&... parts) const {
    return ends_with(0, {}, words(parts...));
  }
  /// What a line that succeeds prints.
  template <class... Parts>
  [[nodiscard]] nlohmann::json printed(const Parts&... parts) const {
    return nlohmann::json::parse(succeeds(parts...).out);
  }
  /// Texts that standard error must hold: one or several.
  struct Says : Words {
    Says() = default;
    Says(const char* one) : Words{one} {}         // NOLINT(google-explicit-constructor)
    Says(const std::string& one) : Words{one} {}  // NOLINT(google-explicit-constructor)
    Says(std::initializer_list<std::string> all) : Words(all) {}
    Says(const Words& all) : Words(all) {}  // NOLINT(google-explicit-constructor)
  };
  /// The line must end with exit status 2 and say why.
  template <class... Parts>
  ProcessOutcome refuses(const Says& says, const Parts&... parts) const {
    return ends_with(2, says, words(parts...));
  }
  [[nodiscard]] ProcessOutcome run_line(const Words& line) const;
  ProcessOutcome ends_with(int status, const Says& says, const Words& line) const;

  [[nodiscard]] bool exists(const std::string& name) const { return std::filesystem::exists(in(name)); }
  [[nodiscard]] std::string text_in(const std::string& name) const { return file_text(in(name)); }
  [[nodiscard]] nlohmann::json json_in(const std::string& name) const {
    return nlohmann::json::parse(text_in(name));
  }
  /// A folder of a version that kept no page is drawn from its document.
  void draw_without_page(const std::string& out) const {
    for (const char* file : {"/page.json", "/report.html"}) std::filesystem::remove(in(out + file));
    succeeds("report", in(out));
  }
  /// What no clock has a say in of a sweep, by setting.
  [[nodiscard]] std::map<std::string, nlohmann::json> exact(const std::string& out) const {
    std::map<std::string, nlohmann::json> all;
    const nlohmann::json whole = json_in(out + "/sweep.json");
    for (const nlohmann::json& row : whole["rows"])
      for (const char* name : {"trace_hash", "error_p95_percent", "bytes", "points", "status"})
        all[row["setting"]][name] = row[name];
    return all;
  }
  /// The document must follow docs/schemas/NAME.schema.json.
  static void expect_valid(const std::string& name, const std::string& document);

  /// Each line runs in a process of its own: for what goes on with a stopped process's work, or starts itself
  /// again.
  bool apart_ = false;

 private:
  void add(Words& all, const char* part) const;
  static void add(Words& all, const std::string& part) { all.push_back(part); }
  static void add(Words& all, const Words& part) { all.insert(all.end(), part.begin(), part.end()); }
};
#endif

}  // namespace palpate::experiments

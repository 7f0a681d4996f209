#include "experiments/stress/apart.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>

#include "toolkit/core/at_stop.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/fork_ready.h"

namespace palpate::experiments {

NLOHMANN_JSON_SERIALIZE_ENUM(CellStatus, {{CellStatus::kSkipped, "skipped"},
                                          {CellStatus::kOk, "ok"},
                                          {CellStatus::kLimit, "limit"},
                                          {CellStatus::kFailed, "failed"}})
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StressCell, renderer, name, status, check, cause, warnings, trace_hash,
                                   frames, contact_frames, bound_hits, largest_force_n, twin_difference_n,
                                   twin_bound_n)

namespace {

/// The other process: runs cells from `first` on and writes a line for each.
[[noreturn]] void serve_row(int out, const std::vector<StressCase>& cases, std::size_t first,
                            const RendererRequest& request, const render::Registry& registry,
                            const CellLimits& limits) {
  const rlimit memory{limits.bytes, limits.bytes}, none{0, 0};
  ::setrlimit(RLIMIT_DATA, &memory);
  ::setrlimit(RLIMIT_CORE, &none);
  for (std::size_t i = first; i < cases.size(); ++i) {
    const std::string line = to_line(run_cell(cases[i], request, registry)) + "\n";
    for (std::size_t done = 0; done < line.size();) {
      const ssize_t n = ::write(out, line.data() + done, line.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) ::_exit(1);
      done += static_cast<std::size_t>(n);
    }
  }
  ::_exit(0);  // what this process has of the other one is not its to end
}

class RowProcess {
 public:
  RowProcess(const std::vector<StressCase>& cases, std::size_t first, const RendererRequest& request,
             const render::Registry& registry, const CellLimits& limits) {
    int ends[2];
    if (!end_waiting_threads() || ::pipe2(ends, O_CLOEXEC) != 0) return;
    auto hold = hold_stop();
    std::fflush(nullptr);  // or both processes would write it
    pid_ = ::fork();
    if (pid_ == 0) {
      forget_stop_actions();
      static_cast<void>(hold.release());  // forgotten with the actions
      std::signal(SIGINT, SIG_IGN);       // Ctrl-C reaches all processes: the other one ends this one
      std::signal(SIGTERM, SIG_DFL);
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::close(ends[0]);
      serve_row(ends[1], cases, first, request, registry, limits);
    }
    ::close(ends[1]);
    in_ = ends[0];
    if (pid_ < 0) return;
    at_stop_ = AtStop([pid = pid_] {
      ::kill(pid, SIGKILL);
      return std::string();
    });
  }
  RowProcess(const RowProcess&) = delete;
  RowProcess& operator=(const RowProcess&) = delete;
  ~RowProcess() {
    if (in_ >= 0) ::close(in_);
    end();
  }
  [[nodiscard]] bool runs() const noexcept { return pid_ > 0; }

  enum class Heard { kLine, kEnded, kTooLong };
  Heard line(double seconds, std::string& text) {
    const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(1e9 * kWaits * seconds);
    const double until_s = processor_seconds() + seconds;
    for (;;) {
      if (const std::size_t end = held_.find('\n'); end != std::string::npos) {
        text = held_.substr(0, end);
        held_.erase(0, end + 1);
        return Heard::kLine;
      }
      const std::int64_t left_ms = (until_ns - monotonic_ns()) / 1'000'000;
      if (left_ms <= 0 || processor_seconds() > until_s) return Heard::kTooLong;
      pollfd watched{in_, POLLIN, 0};
      const int ready = ::poll(&watched, 1, static_cast<int>(std::min<std::int64_t>(left_ms, kLookMs)));
      if (ready <= 0) continue;
      char piece[4096];
      const ssize_t n = ::read(in_, piece, sizeof(piece));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return Heard::kEnded;
      held_.append(piece, static_cast<std::size_t>(n));
    }
  }

  /// Ends it; how it ended.
  int end() {
    if (pid_ <= 0) return 0;
    at_stop_.drop();
    ::kill(pid_, SIGKILL);  // one that has ended by itself keeps its own status
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = 0;
    return status;
  }

 private:
  /// Of the other process; a busy machine makes no cell red.
  [[nodiscard]] double processor_seconds() const noexcept {
    clockid_t clock{};
    timespec spent{};
    if (::clock_getcpuclockid(pid_, &clock) != 0 || ::clock_gettime(clock, &spent) != 0) return 0.0;
    return static_cast<double>(spent.tv_sec) + 1e-9 * static_cast<double>(spent.tv_nsec);
  }

  static constexpr std::int64_t kLookMs = 200;
  static constexpr double kWaits =
      10.0;  ///< one that waits, for a program of its own or for ever, may take longer
  pid_t pid_ = -1;
  int in_ = -1;
  std::string held_;
  AtStop at_stop_;
};

StressCell crashed(const StressCase& one, const RendererRequest& request, RowProcess::Heard heard, int status,
                   const CellLimits& limits) {
  StressCell cell;
  cell.renderer = request.label;
  cell.name = one.name;
  cell.status = CellStatus::kFailed;
  cell.check = "crash";
  if (heard == RowProcess::Heard::kTooLong)
    cell.cause = fmt::format("it was not done after {:g} s of processor time", limits.seconds);
  else if (WIFSIGNALED(status))
    cell.cause = fmt::format("its process was ended by signal {} ({})", WTERMSIG(status),
                             ::strsignal(WTERMSIG(status)));
  else
    cell.cause = fmt::format("its process ended with status {}", WEXITSTATUS(status));
  return cell;
}

}  // namespace

std::string to_line(const StressCell& cell) {
  return nlohmann::json(cell).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

bool from_line(const std::string& line, StressCell& cell) {
  try {
    cell = nlohmann::json::parse(line).get<StressCell>();
    return true;
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

void run_row_apart(const std::vector<StressCase>& cases, const RendererRequest& request,
                   const render::Registry& registry, const CellLimits& limits,
                   const std::function<bool(StressCell&&)>& ready) {
  for (std::size_t next = 0; next < cases.size();) {
    RowProcess process(cases, next, request, registry, limits);
    if (!process.runs()) {
      if (!ready(run_cell(cases[next++], request, registry))) return;
      continue;
    }
    for (bool alive = true; alive && next < cases.size(); ++next) {
      std::string text;
      StressCell cell;
      const RowProcess::Heard heard = process.line(limits.seconds, text);
      alive = heard == RowProcess::Heard::kLine && from_line(text, cell);
      // A process that ended by itself is a zombie yet: waiting tells how, killing it changes nothing.
      if (!alive) cell = crashed(cases[next], request, heard, process.end(), limits);
      if (!ready(std::move(cell))) return;
    }
  }
}

}  // namespace palpate::experiments

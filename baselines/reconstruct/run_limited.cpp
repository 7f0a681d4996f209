#include "baselines/reconstruct/reconstruct.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "toolkit/core/process.h"

namespace palpate::baselines {
namespace {

namespace fs = std::filesystem;

constexpr const char* kProgram = "palpate-reconstruct";
constexpr double kGigabyte = 1e9, kMsPerS = 1e3;
constexpr std::uint64_t kLongestMessage = std::uint64_t{1}
                                          << 37;  // longer than a mesh of a billion triangles
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
               "install all of Palpate, or set PALPATE_RECONSTRUCT to where it is", places.front().string()};
}

/// Parses a worker's messages and reports its progress.
class Talk {
 public:
  Talk(const Limits& limits, std::string method, Progress& progress)
      : limits_(limits), method_(std::move(method)), progress_(progress) {}

  /// False once the answer is complete.
  bool hear(std::string& received) {
    while (!answer_ && received.size() >= kMessageHead) {
      std::uint64_t size = 0;
      std::memcpy(&size, received.data() + 1, sizeof size);
      if (size > kLongestMessage) {
        answer_ = Error{method_ + " gave an answer that cannot be read", "install all of Palpate anew"};
        break;
      }
      if (received.size() - kMessageHead < size) {
        if (received.capacity() < kMessageHead + size + kPiece)
          received.reserve(kMessageHead + size + kPiece);
        return true;
      }
      take(static_cast<WorkerMessage>(received[0]),
           std::string_view(received).substr(kMessageHead, static_cast<std::size_t>(size)));
      received.erase(0, kMessageHead + size);
    }
    return !answer_;
  }
  /// False: stop the worker.
  bool tell() {
    if (progress_.cancelled()) return false;
    const double s = watch_.ms() / kMsPerS;
    progress_.report(limits_.time_s > 0.0
                         ? fmt::format("{}: {}, {:.0f} of at most {:g} s", method_, phase_, s, limits_.time_s)
                         : fmt::format("{}: {}, {:.0f} s", method_, phase_, s),
                     -1.0);
    return true;
  }
  Result<Reconstruction> result_of(const ProcessOutcome& outcome) && {
    if (answer_) return *std::move(answer_);
    if (outcome.timed_out)
      return gave_up(fmt::format("did not finish in {:g} s", limits_.time_s), "allow more time");
    if (outcome.stopped) return Error{method_ + " was stopped"};
    Error error{method_ + " ended without an answer", "take other options or another reconstruction"};
    if (outcome.signal != 0)
      error.what = fmt::format("{} crashed ({})", method_, ::strsignal(outcome.signal));
    if (!outcome.last_line.empty()) error.what += ": " + outcome.last_line;
    return error;
  }

 private:
  void take(WorkerMessage kind, std::string_view text) {
    InputArchive body(text);
    switch (kind) {
      case WorkerMessage::kResult:
        answer_ = read_reconstruction(body);
        break;
      case WorkerMessage::kError:
        answer_ = read_error(body);
        break;
      case WorkerMessage::kNoMemory:
        answer_ = gave_up(
            fmt::format("needed more than {:.3g} GB", static_cast<double>(memory_limit(limits_)) / kGigabyte),
            "allow more memory");
        break;
      case WorkerMessage::kProgress:
        phase_ = text;
        break;
    }
  }
  [[nodiscard]] Error gave_up(const std::string& why, const std::string& remedy) const {
    Error error{fmt::format("{} {} (it was at: {})", method_, why, phase_),
                remedy + ", or use fewer points or another reconstruction"};
    error.gave_up = true;
    return error;
  }

  Limits limits_;
  std::string method_;
  Progress& progress_;
  std::string phase_ = "starting";
  std::optional<Result<Reconstruction>> answer_;
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
  PALPATE_ASSIGN(const std::string program, find_program());
  if (progress.cancelled()) return Error{method.name + " was stopped"};
  std::vector<std::string> arguments = {program, method.name, std::to_string(threads),
                                        std::to_string(memory_limit(limits)), std::to_string(::getpid())};
  for (const auto& [key, value] : options.all()) arguments.push_back(key + "=" + value);
  OutputArchive body, message;
  write(body, cloud);
  message(body.bytes());
  Talk talk(limits, method.name, progress);
  ProcessSocket channel{std::move(message).take(),
                        [&talk](std::string& received) { return talk.hear(received); }};
  ProcessOptions how;
  how.time_limit_s = limits.time_s;
  how.grace_s = 0.0;  // nothing to clean up
  how.tick = [&talk] { return talk.tell(); };
  how.talk = &channel;
  PALPATE_ASSIGN(const ProcessOutcome outcome, run_process(arguments, how));
  return std::move(talk).result_of(outcome);
}

}  // namespace palpate::baselines

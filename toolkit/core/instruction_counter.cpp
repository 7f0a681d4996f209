#include "toolkit/core/instruction_counter.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string_view>
#include <system_error>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/process.h"

#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#define PALPATE_HAS_MARKS 1
#endif

namespace palpate {

#ifdef PALPATE_HAS_MARKS
void begin_counting() noexcept {
  // Preparation threads that fall asleep meanwhile would be counted too.
  (void)stop_idle_workers();
  CALLGRIND_START_INSTRUMENTATION;
}
void end_counting(const char* name) noexcept {
  CALLGRIND_STOP_INSTRUMENTATION;
  CALLGRIND_DUMP_STATS_AT(name);
}
#else
void begin_counting() noexcept {}
void end_counting(const char* /*name*/) noexcept {}
#endif

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kNameKey = "desc: Trigger: Client Request: ";
constexpr std::string_view kTotalKey = "totals: ";

/// A temporary folder, removed with this object.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code code;
    std::string path = (fs::temp_directory_path(code) / "palpate-count-XXXXXX").string();
    const auto held = block_stop();
    if (code || ::mkdtemp(path.data()) == nullptr) return;
    path_ = path;
    stop_callback_ = StopCallback([path] {
      std::error_code gone;
      fs::remove_all(path, gone);
      return std::string();
    });
  }
  ~ScratchFolder() {
    std::error_code code;
    if (!path_.empty()) fs::remove_all(path_, code);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
  StopCallback stop_callback_;
};

/// Adds a part from a callgrind file; the final one has no name.
void read_part(const fs::path& file, std::map<std::string, std::uint64_t>& parts) {
  constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 28;  // one has some hundred kilobytes
  const Result<std::string> text = read_file(file.string(), kMostBytes);
  if (!text) return;
  std::istringstream lines(*text);
  std::string name;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(kNameKey)) name = line.substr(kNameKey.size());
    if (!name.empty() && line.starts_with(kTotalKey))
      parts[name] += std::strtoull(line.c_str() + kTotalKey.size(), nullptr, 10);
  }
}

std::size_t files_in(const fs::path& folder) {
  std::error_code code;
  std::size_t files = 0;
  for (fs::directory_iterator at(folder, code), end; !code && at != end; at.increment(code)) ++files;
  return files;
}

}  // namespace

Status can_count_instructions() {
#ifndef PALPATE_HAS_MARKS
  return Error{"this program was built without valgrind's header",
               "install valgrind (apt-get install valgrind) and build again"};
#endif
  if (!program_exists("valgrind")) return Error{"valgrind is not installed", "apt-get install valgrind"};
  return Done{};
}

Result<std::map<std::string, std::uint64_t>> count_instructions(const std::vector<std::string>& command,
                                                                const CountOptions& options) {
  PALPATE_TRY(can_count_instructions());
  const ScratchFolder scratch;
  if (scratch.path().empty())
    return Error{"no folder can be made for callgrind's files", "set TMPDIR to one that is yours"};
  std::vector<std::string> arguments = {"valgrind", "--tool=callgrind", "--instr-atstart=no",
                                        "--callgrind-out-file=" + (scratch.path() / "out").string()};
  arguments.insert(arguments.end(), command.begin(), command.end());
  ProcessOptions run;
  run.time_limit_s = options.time_limit_s;
  if (options.tick) run.tick = [&] { return options.tick(files_in(scratch.path())); };
  PALPATE_ASSIGN(const ProcessOutcome outcome, run_process(arguments, run));
  if (outcome.timed_out || outcome.stopped)
    return Error{fmt::format("counting was stopped after {:g} s", options.time_limit_s),
                 "give it more time, or a smaller scene"};
  if (outcome.exit_code != 0)
    return Error{
        fmt::format("the counted program ended with status {}: {}", outcome.exit_code, outcome.last_line),
        "run it without valgrind to see why"};
  std::map<std::string, std::uint64_t> parts;
  std::error_code code;
  for (fs::directory_iterator at(scratch.path(), code), end; !code && at != end; at.increment(code))
    read_part(at->path(), parts);
  return parts;
}

}  // namespace palpate

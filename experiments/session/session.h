// Helpers of whole commands: exit statuses, full registries, options, document heads. Arguments become
// options; the dependencies of a run's results become one word.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/registry.h>
#include <palpate/scene.h>
#include "experiments/report/findings.h"
#include "experiments/report/tables.h"
#include "experiments/run/arguments.h"
#include "toolkit/core/hash.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

// The terminal that somebody looks at: how wide it is, a progress bar with the time left, and what is
// printed.

/// Columns of the terminal behind a file descriptor: what the environment's COLUMNS says, else what the
/// terminal itself does, else 80 (a pipe, a file).
[[nodiscard]] std::size_t terminal_columns(int descriptor);

/// Prints all tables, or of the first one what fits `kBriefLines` and how many lines more there are.
inline constexpr std::size_t kBriefLines = 10;
void print_tables(const std::vector<Table>& tables, bool whole);
/// Tells each line on standard error: all, or three lines at most, of which the last says how many there are
/// more.
void tell_lines(const std::vector<std::string>& lines, bool all);
/// Prints what a page answers first, wrapped.
void print_answer(const Headline& answer);
/// Prints the scores of a study: all, or a line a renderer and the finding that the report begins with.
void print_scores(const metrics::ResultDocument& document, bool whole);

/// Draws on standard error from the second second of a phase on; on anything but a terminal a job of
/// several steps (set_prefix) prints a line every few seconds, and any other nothing.
class ProgressBar final : public Progress {
 public:
  ProgressBar();
  ~ProgressBar() override;
  void report(std::string_view what, double fraction) override;

  /// Removes what is drawn, before other text is printed.
  void clear();
  /// Put before every phase, "[2/5] sinusoid: ".
  void set_prefix(std::string prefix) { prefix_ = std::move(prefix); }

 private:
  bool terminal_ = false;
  bool drawn_ = false;
  std::string prefix_;
  std::string phase_;
  std::int64_t phase_start_ns_ = 0;
  std::int64_t last_draw_ns_ = 0;
};

/// A run goes on from an interrupted one only where the two have the same key: the same program on the same
/// machine, and everything that was added. Not for security.
class RunKey {
 public:
  RunKey();
  /// Of every program and machine: for a record whose rows hold whatever program and machine wrote them, or
  /// say which (a study that lasts weeks, a sweep that goes on at another machine).
  [[nodiscard]] static RunKey of_any_program() { return RunKey(Hash64()); }
  RunKey& add(std::string_view text);
  RunKey& add(double value);
  RunKey& add(std::uint64_t value);
  /// Name and content; a file that cannot be read counts as empty.
  RunKey& add_file(const std::string& path);
  [[nodiscard]] std::string word() const { return hash_.hex(); }

 private:
  explicit RunKey(Hash64 hash) : hash_(hash) {}
  Hash64 hash_;
};

/// Further dependencies of one renderer's results.
[[nodiscard]] std::string key_of(const RendererRequest& request);

/// A word of a command line, quoted where a shell needs it.
[[nodiscard]] std::string for_shell(const std::string& argument);

inline constexpr int kExitOk = 0;
inline constexpr int kExitFellShort = 1;  ///< ran, and failed or fell short
inline constexpr int kExitBadInput = 2;   ///< bad arguments or input

/// A case that a process of its own can measure: a row of jobs.tsv.
struct Case {
  std::string name{};  ///< a file name, or what case_id() makes one of; unique within the command
  std::string scene{}, renderer{}, setting{};
  double seconds = 60.0, megabytes = 1000.0;  ///< expected; these where nobody knows: a minute, a gigabyte
  bool timed = true;                          ///< work beside it would falsify it
};

/// Of a renderer whose answers are counted and not timed.
[[nodiscard]] Case untimed(const RendererRequest& request);

/// Choice of a command's cases that this process measures: all, none (they are listed), or one.
struct CaseSelection {
  bool list = false;       ///< --emit, --engine
  bool run = false;        ///< --engine: what is listed is run
  std::string only;        ///< --case: an id, or kNoCase
  std::string command;     ///< the command line without these options, for a shell
  bool anew = false;       ///< listed: nothing was kept before
  bool found = false;      ///< the one case is measured
  std::vector<Case> left;  ///< listed so far
  std::string written;     ///< the folder with the list
  [[nodiscard]] bool all() const { return !list && only.empty(); }
};

/// Context of every command.
struct Context {
  ProgressBar& progress;
  std::string command_line;  ///< as typed, quoted where needed
  bool verbose = false;      ///< every table is printed
  bool working = false;      ///< set by a command behind its checks: an Error is no bad input any more
  CaseSelection cases{};
};

/// Prints "palpate: error: ..." and returns `status`.
int fail(const Error& error, int status, ProgressBar* progress = nullptr);

/// A command's exit status. Its Error is told: kExitBadInput, or kExitFellShort once it was working.
[[nodiscard]] int exit_status(const Result<int>& status, Context& context);

/// While it is there, the first signal that would stop the program asks what is going on to end by itself
/// instead, as if it were over. One at a time.
class EndOnStop {
 public:
  /// `end` runs in another thread. False: it does not end in time, and the program is stopped.
  explicit EndOnStop(std::function<bool()> end);
  ~EndOnStop() { (void)over(); }
  EndOnStop(const EndOnStop&) = delete;
  EndOnStop& operator=(const EndOnStop&) = delete;
  /// It is over: from here on a signal stops the program. The one that ended it; 0: none.
  int over();

 private:
  std::function<bool()> end_;
};
/// For the thread that waits for signals: whether what is going on ends by itself.
[[nodiscard]] bool ends_on_stop(int signal);

/// Arguments of all commands that load a model.
struct ModelArguments {
  std::string unit;              ///< empty: as the file says
  double scale = 0.0;            ///< 0: as the scene says
  double post_mm = 0.0;          ///< height grids: distance of posts; 0: as the file says
  double vertical_mm = 0.0;      ///< height grids: mm of 1; 0: the unit
  std::string no_data;           ///< height grids: the number that stands for none; empty: the file's
  std::string within;            ///< the box that is taken of it: six numbers in mm; empty: the scene's
  std::string non_finite;        ///< drop, refuse; empty: drop
  double memory_limit_gb = 0.0;  ///< of reading one file; 0: kMemoryLimitBytes
  int threads = 0;               ///< 0 = all
};

[[nodiscard]] render::Registry all_renderers();
[[nodiscard]] io::Readers all_readers();
/// The first option given that says what a model file's numbers mean; empty: none.
[[nodiscard]] std::string given_for_model_files(const ModelArguments& arguments);
/// The corners that --within names, mm.
[[nodiscard]] Result<geometry::Aabb> parse_within(const std::string& text);
[[nodiscard]] Result<scene::LoadOptions> load_options(const ModelArguments& arguments);

/// Everything about program, machine and time.
[[nodiscard]] metrics::DocumentHead new_head(const std::string& command_line);
/// Flags and libraries of this program.
void add_program(metrics::MeasurementConditions& conditions);
/// A document with this head.
[[nodiscard]] metrics::ResultDocument new_document(const std::string& command_line);

/// Adds pcd, tif, tiff, png, hgt, dem, asc and zip, as far as they were built. The module palpate-formats.so
/// is looked for where the program's run path says and is loaded once, by the first file of these formats; an
/// Error of that file where it is not there. Thread-safe.
void add_library_formats(io::Readers& readers);

}  // namespace palpate::experiments

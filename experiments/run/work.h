// A renderer at work on a stage: prepared, replayed, timed. Its answers stand in memory that another process
// may read: a seat is such a process.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "experiments/run/run.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::experiments {

/// Where the answers are put: each as long as the path, but for the last.
struct Answers {
  std::span<render::Frame> frames;                ///< of the untimed pass
  std::span<std::uint8_t> contact;                ///< given: the frames that are timed as contact
  std::span<trace::FrameSpanTime> stretch_times;  ///< of the last pass, by stretch of `contact`
  std::span<std::uint32_t> frame_ns;              ///< of the last pass
  std::span<trace::PacedStatistics, 2> paced;     ///< plain, evicted
};

/// Tasks, in this order: prepare, then any of the others.
enum class Task : char {
  kPrepare = 'p',  ///< and the untimed pass; the answer is the run without its trace
  kPasses = 't',   ///< warm-up, then one pass of each kind
  kPaced = 'c',    ///< paced passes, warm and cold
  kPin = 'x',      ///< stays on one processor from here on; the answer names it
};

class Work {
 public:
  Work(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
       const RunOptions& options, const Answers& answers);
  ~Work();
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;

  /// Does a task and answers a text; see Task. An Error ends the run of this renderer.
  [[nodiscard]] Result<std::string> operator()(Task task, Progress& progress);

 private:
  [[nodiscard]] Result<std::string> prepare(Progress& progress);
  [[nodiscard]] Status replay(Run& run);
  [[nodiscard]] Status passes();
  [[nodiscard]] Status paced(Progress& progress);

  const Stage& stage_;
  const RendererRequest& request_;
  const render::Registry& registry_;
  const RunOptions& options_;
  Answers answers_;
  std::unique_ptr<render::HapticRenderer> renderer_;
  std::unique_ptr<StreamFeed> feed_;               ///< of a stage's stream
  const render::HapticRenderer* inner_ = nullptr;  ///< whose mesh is saved; control has none
  std::optional<trace::TimedPasses> passes_;
};

/// The head of a run's result: who it is and what it gets.
[[nodiscard]] metrics::RendererResult begin_result(const Stage& stage, const RendererRequest& request,
                                                   const render::Registry& registry, int threads);
/// A run as a text without its trace, and from it again.
[[nodiscard]] std::string result_text(const Run& run);
[[nodiscard]] Result<Run> run_of(const std::string& text);

// Where a renderer sits while it is measured: in a process of its own, forked from this one, so that no
// renderer inherits what another one left in memory, threads or caches of libraries, and all can stay
// prepared and take turns. Where a process cannot be forked it works in this one.

class Seat {
 public:
  /// `apart`: in a process of its own, where that can be had. Objects referred to must outlive the seat.
  Seat(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
       const RunOptions& options, bool apart);
  ~Seat();  ///< ends the process
  Seat(const Seat&) = delete;
  Seat& operator=(const Seat&) = delete;

  /// Does the task there and waits. A process that ends by itself is an Error that says how.
  [[nodiscard]] Result<std::string> ask(Task task, Progress& progress);
  [[nodiscard]] const Answers& answers() const;
  [[nodiscard]] bool is_apart() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Whether another renderer finds room beside those that sit already: a third of the machine's memory is
/// free.
[[nodiscard]] bool has_room();

// A forked copy of this process that does tasks: what it leaves in memory, threads and caches ends with it,
// and its crash or hang is an Error here.

struct ChildLimits {
  double task_s = 0.0;      ///< processor time of one task; 0: none
  std::uint64_t bytes = 0;  ///< private memory; 0: none
};

class Child {
 public:
  using Work = std::function<Result<std::string>(std::uint64_t task, Progress& progress)>;

  /// `apart`: in a process of its own, where one can be forked; else the tasks are done in this one. Objects
  /// that `work` refers to must outlive the child.
  Child(Work work, bool apart, const ChildLimits& limits = {});
  ~Child();  ///< ends the process and what it started; so does a stop of this program
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Does the task there and waits. Error: the work's; a process that ends by itself or reaches a limit,
  /// which is then gone (`alive()`).
  [[nodiscard]] Result<std::string> ask(std::uint64_t task, Progress& progress);
  [[nodiscard]] bool is_apart() const;
  /// False once its process is gone.
  [[nodiscard]] bool alive() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::experiments

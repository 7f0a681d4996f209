#include "experiments/psychophysics/rig.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <utility>

#include <palpate/result.h>
#include "toolkit/core/messages.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::experiments::psychophysics {
namespace {

// The C interface of liblsl, from its public headers (lsl/streaminfo.h, lsl/outlet.h, lsl/common.h of version
// 1.14): handles are opaque pointers, a format is a four-byte enumeration, push returns 0 or an error code
// below it.
struct LslInfoBody;
struct LslOutletBody;
using LslInfo = LslInfoBody*;
using LslOutlet = LslOutletBody*;
constexpr std::int32_t kLslText = 3;      // cft_string
constexpr double kLslIrregular = 0.0;     // LSL_IRREGULAR_RATE
constexpr std::int32_t kLslBuffer = 360;  // seconds, or hundreds of an irregular stream's samples

struct LslFunctions {
  LslInfo (*create_streaminfo)(const char*, const char*, std::int32_t, double, std::int32_t, const char*);
  LslOutlet (*create_outlet)(LslInfo, std::int32_t, std::int32_t);
  std::int32_t (*push_sample)(LslOutlet, const char**, double);
  double (*local_clock)();
  void (*destroy_outlet)(LslOutlet);
  void (*destroy_streaminfo)(LslInfo);
};

struct LibraryCloser {
  void operator()(void* handle) const noexcept { dlclose(handle); }
};
using Library = std::unique_ptr<void, LibraryCloser>;

template <class Function>
Status find_in(const Library& library, const char* name, const std::string& file, Function*& function) {
  function = reinterpret_cast<Function*>(dlsym(library.get(), name));
  if (function != nullptr) return Done{};
  return Error{fmt::format("the library has no function {}", name), "install liblsl 1.13 or newer", file};
}

class LslMarkers final : public Markers {
 public:
  LslMarkers(Library library, const LslFunctions& lsl, LslInfo info, LslOutlet outlet) noexcept
      : library_(std::move(library)), lsl_(lsl), info_(info), outlet_(outlet) {}
  ~LslMarkers() override {
    lsl_.destroy_outlet(outlet_);
    lsl_.destroy_streaminfo(info_);
  }
  void push(const std::string& text, double seconds_ago) override {
    const char* const sample = text.c_str();
    const char* samples[] = {sample};
    // A mark that fails to go out is ignored; the trial continues.
    (void)lsl_.push_sample(outlet_, samples, lsl_.local_clock() - seconds_ago);
  }

 private:
  Library library_;
  LslFunctions lsl_;
  LslInfo info_;
  LslOutlet outlet_;
};

}  // namespace

Result<std::unique_ptr<Markers>> lsl_markers(const std::string& library, const std::string& source) {
  // The library stays loaded: its threads may outlive its objects.
  Library opened(dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE));
  if (!opened) {
    const char* const why = dlerror();
    return Error{fmt::format("Lab Streaming Layer is not there: {}", why == nullptr ? "no library" : why),
                 "install liblsl, or name its file with --lsl-library", library};
  }
  LslFunctions lsl{};
  PALPATE_TRY(find_in(opened, "lsl_create_streaminfo", library, lsl.create_streaminfo));
  PALPATE_TRY(find_in(opened, "lsl_create_outlet", library, lsl.create_outlet));
  PALPATE_TRY(find_in(opened, "lsl_push_sample_strt", library, lsl.push_sample));
  PALPATE_TRY(find_in(opened, "lsl_local_clock", library, lsl.local_clock));
  PALPATE_TRY(find_in(opened, "lsl_destroy_outlet", library, lsl.destroy_outlet));
  PALPATE_TRY(find_in(opened, "lsl_destroy_streaminfo", library, lsl.destroy_streaminfo));
  LslInfo const info =
      lsl.create_streaminfo("Palpate", "Markers", 1, kLslIrregular, kLslText, source.c_str());
  LslOutlet const outlet = info == nullptr ? nullptr : lsl.create_outlet(info, 0, kLslBuffer);
  if (outlet == nullptr) {
    if (info != nullptr) lsl.destroy_streaminfo(info);
    return Error{"Lab Streaming Layer opens no stream", "look at what its library says", library};
  }
  return std::unique_ptr<Markers>(std::make_unique<LslMarkers>(std::move(opened), lsl, info, outlet));
}

namespace {

// Delay before a person is asked again to lift off.
constexpr double kAskAgainS = 3.0;
constexpr double kServoNsPerS = 1e9, kServoUsPerNs = 1e-3;

/// Next input from a standard input that is no terminal; a terminal's keys go to the session.
enum class Piped : std::uint8_t { kNothing, kKey, kEnd };
Piped read_piped(char& key) {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  if (poll(&input, 1, 0) <= 0) return Piped::kNothing;
  return read(STDIN_FILENO, &key, 1) == 1 ? Piped::kKey : Piped::kEnd;
}

/// work() runs on the worker, key() on the main thread.
class PersonTasks final : public SessionTasks {
 public:
  PersonTasks(const Plan& plan, Bench& bench, Rig& rig, Ledger& ledger, const OutputFolder& folder,
              Markers& markers, const Clock& clock)
      : plan_(plan),
        bench_(bench),
        rig_(rig),
        ledger_(ledger),
        folder_(folder),
        markers_(markers),
        clock_(clock),
        terminal_(isatty(STDIN_FILENO) != 0) {}

  void work(double now_s) override {
    if (!failed_.what.empty() || ended_) return;
    if (const Status done = go_on(now_s); !done) {
      failed_ = done.error();
      rig_.assembly().request_stop();
    }
  }
  void key(char pressed) override { key_.store(pressed, std::memory_order_release); }

  /// Sets the level that the rig was built for.
  void level_is(double level) { level_ = level; }
  [[nodiscard]] const Error& failed() const { return failed_; }
  [[nodiscard]] PersonSession session() const { return session_; }

 private:
  enum class Step : std::uint8_t { kNext, kBreak, kPrepare, kOffered, kBegin, kFelt, kAsk };

  Status go_on(double now_s);
  Status take_next();
  Status prepare();
  void begin(double now_s);
  Status follow(double now_s);
  Status ask(double now_s);
  void end(const std::string& why);
  void mark(const std::string& what, double servo_s);
  char pressed();
  void announce(std::string text) { rig_.assembly().announce(std::move(text)); }

  const Plan& plan_;
  Bench& bench_;
  Rig& rig_;
  Ledger& ledger_;
  const OutputFolder& folder_;
  Markers& markers_;
  const Clock& clock_;
  bool terminal_;
  std::atomic<char> key_{0};
  Step step_ = Step::kNext;
  Trial trial_;
  double level_ = 0.0;
  std::unique_ptr<render::HapticRenderer> offered_;
  std::uint32_t interval_announced_ = 0;
  Passage passage_announced_ = Passage::kIdle;
  double announced_s_ = 0.0, asked_s_ = 0.0;
  FeltTrial felt_;
  bool ended_ = false;
  Error failed_{};
  PersonSession session_;
};

char PersonTasks::pressed() {
  if (const char key = key_.exchange(0, std::memory_order_acquire); key != 0) return key;
  if (terminal_) return 0;
  char key = 0;
  const Piped piped = read_piped(key);
  if (piped == Piped::kEnd || (piped == Piped::kKey && key == 'q')) end("stopped");
  return piped == Piped::kKey ? key : '\0';
}

void PersonTasks::end(const std::string& why) {
  ended_ = true;
  announce(why);
  rig_.assembly().request_stop();
}

void PersonTasks::mark(const std::string& what, double servo_s) {
  const double now_s = static_cast<double>(clock_.now_ns()) / kServoNsPerS;
  markers_.push(fmt::format("trial {} {}", trial_.number, what), std::max(0.0, now_s - servo_s));
}

Status PersonTasks::take_next() {
  PALPATE_ASSIGN(const std::optional<Trial> next, ledger_.next());
  if (!next || ledger_.session_over()) {
    session_.complete = !next;
    end(next ? "that is all for this session" : "that was the last one. Thank you");
    return Done{};
  }
  trial_ = *next;
  if (trial_.break_before) announce("a break: rest as long as you like, then press space");
  step_ = trial_.break_before ? Step::kBreak : Step::kPrepare;
  return Done{};
}

/// Prepares the renderer of the trial's level before the trial starts.
Status PersonTasks::prepare() {
  if (plan_.compares() || trial_.level == level_) {
    step_ = Step::kBegin;
    return Done{};
  }
  if (!offered_) {
    PALPATE_ASSIGN(offered_, rig_.renderer_of(trial_.level, no_progress()));
  }
  if (!rig_.conductor().calm() || !rig_.mixer().offer(offered_, kLaneOfB)) return Done{};
  step_ = Step::kOffered;
  return Done{};
}

void PersonTasks::begin(double now_s) {
  if (!rig_.conductor().calm()) {
    if (now_s - announced_s_ > kAskAgainS) announce("lift off, please"), announced_s_ = now_s;
    return;
  }
  interval_announced_ = 0;
  passage_announced_ = Passage::kIdle;
  rig_.conductor().begin(bench_.passes(trial_));
  mark("begins", static_cast<double>(clock_.now_ns()) / kServoNsPerS);
  step_ = Step::kFelt;
}

/// Prompts through a trial's passages and takes its end.
Status PersonTasks::follow(double now_s) {
  Conductor& conductor = rig_.conductor();
  const Passage passage = conductor.passage();
  const std::uint32_t interval = conductor.interval();
  if (interval != interval_announced_) {
    interval_announced_ = interval;
    mark(fmt::format("interval {}", interval), conductor.since_s());
    announce(fmt::format("trial {}: touch {} of {}", trial_.number, interval, trial_.shown.size()));
  }
  if (passage == Passage::kLeaving && (passage_announced_ != passage || now_s - announced_s_ > kAskAgainS)) {
    announce("lift off");
    announced_s_ = now_s;
  }
  passage_announced_ = passage;
  if (passage == Passage::kStuck)
    return Error{"a renderer of this plan cannot be felt any more: it took too long, or answered no number",
                 "look at it with `palpate live`; the same command goes on from here", plan_.name};
  if (passage == Passage::kBroken) {
    announce("a fault stopped the trial; it begins anew");
    ++session_.record.begun_again;
    step_ = Step::kBegin;
  }
  if (passage != Passage::kDone) return Done{};
  mark("ends", conductor.since_s());
  felt_ = conductor.take();
  PALPATE_TRY(write_trace(folder_, trial_.number, felt_));
  announce(question_of(plan_));
  key_.store(0, std::memory_order_release);  // drops keys pressed during the trial
  asked_s_ = now_s;
  step_ = Step::kAsk;
  return Done{};
}

Status PersonTasks::ask(double now_s) {
  const char key = pressed();
  if (key == 0 || ended_) return Done{};
  const int choice = choice_of(plan_.task, key);
  if (choice < 0) return Done{};
  Answer answer;
  answer.choice = choice;
  answer.confidence = 0;
  answer.seconds = now_s - asked_s_;
  answer.missed_deadlines = felt_.missed_deadlines;
  answer.clipped_frames = felt_.clipped_frames;
  mark(fmt::format("answer {}", choice + 1), static_cast<double>(clock_.now_ns()) / kServoNsPerS);
  PALPATE_TRY(ledger_.enter(trial_, answer));
  if (session_.record.first_trial == 0) session_.record.first_trial = trial_.number;
  session_.record.last_trial = trial_.number;
  session_.record.trial_frames += felt_.frames;
  session_.record.whole_frames += felt_.whole_frames;
  rig_.conductor().return_room(std::move(felt_));
  step_ = Step::kNext;
  return Done{};
}

Status PersonTasks::go_on(double now_s) {
  switch (step_) {
    case Step::kNext:
      return take_next();
    case Step::kBreak:
      if (const char key = pressed(); key == ' ') step_ = Step::kPrepare;
      return Done{};
    case Step::kPrepare:
      return prepare();
    case Step::kOffered:
      // The old renderer returns once the new one has reached the hand.
      if (!rig_.mixer().take_retired()) return Done{};
      level_ = trial_.level;
      step_ = Step::kBegin;
      return Done{};
    case Step::kBegin:
      begin(now_s);
      return Done{};
    case Step::kFelt:
      return follow(now_s);
    case Step::kAsk:
      return ask(now_s);
  }
  return Done{};
}

void report_loop(const SessionEnd& end, bool real_time, double rate_hz, SessionRecord& record) {
  record.real_time = real_time;
  record.scheduling = end.scheduling;
  record.notes = end.notes;
  record.rate_hz = rate_hz;
  record.ticks = end.loop.ticks;
  record.missed = end.loop.missed;
  const device::DurationStatistics& late = end.loop.lateness;
  const auto us = [](auto ns) { return static_cast<double>(ns) * kServoUsPerNs; };
  record.late_p50_us = us(late.p50_ns);
  record.late_p99_us = us(late.p99_ns);
  record.late_p999_us = us(late.p999_ns);
  record.late_most_us = us(late.max_ns);
  record.watchdog_trips = end.watchdog_trips;
}

}  // namespace

std::string question_of(const Plan& plan) {
  switch (plan.task) {
    case Task::kAbx:
      return "was the third like the first (a or 1), or like the second (b or 2)?";
    case Task::kSameDifferent:
      return "the same (s or 1), or different (d or 2)?";
    case Task::kTwoInterval:
      if (plan.option)
        return fmt::format("which had {} {}: the first (1) or the second (2)?",
                           plan.option->upwards ? "more" : "less", plan.option->key);
      return "which was the second of the two that you practised: the first (1) or the second (2)?";
    case Task::kYesNo:
      break;
  }
  return "the one you practised first (1), or the other (2)?";
}

int choice_of(Task task, char key) noexcept {
  if (key == '1') return 0;
  if (key == '2') return 1;
  if (task == Task::kAbx) return key == 'a' ? 0 : key == 'b' ? 1 : -1;
  if (task == Task::kSameDifferent) return key == 's' ? 0 : key == 'd' ? 1 : -1;
  return -1;
}

Result<PersonSession> ask_person(const Plan& plan, Bench& bench, SessionClock& clock, SessionDevice& device,
                                 Ledger& ledger, const OutputFolder& folder, Markers& markers,
                                 ProgressBar& progress) {
  PALPATE_ASSIGN(const std::optional<Trial> first, ledger.next());
  if (!first) return PersonSession{true, false, {}};
  const std::string started_utc = metrics::utc_now();
  PALPATE_ASSIGN(const std::unique_ptr<Rig> rig, Rig::make(bench, clock, device, first->level, progress));
  PersonTasks tasks(plan, bench, *rig, ledger, folder, markers, clock.clock());
  tasks.level_is(first->level);
  PALPATE_ASSIGN(const SessionEnd end, rig->run(tasks, progress));
  if (!tasks.failed().what.empty()) return tasks.failed();
  PersonSession session = tasks.session();
  session.sat = true;
  session.record.started_utc = started_utc;
  report_loop(end, !clock.accelerated(), bench.options().rate_hz, session.record);
  return session;
}

}  // namespace palpate::experiments::psychophysics

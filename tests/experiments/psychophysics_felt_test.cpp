// Blinded studies that feel: trials in a live session, the machine observer, a person by scripted keys.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include <palpate/clock.h>
#include "experiments/psychophysics/rig.h"
#include "tests/experiments/study_folder.h"

namespace palpate::experiments {
namespace {

using psychophysics::Bench;
using psychophysics::FeltTrial;
using psychophysics::Machine;
using psychophysics::Plan;
using psychophysics::Trial;

Plan plan_of(const std::string& example) {
  const auto text = value_of(psychophysics::read_plan(example));
  return value_of(psychophysics::parse_plan(text.text, text.name, all_renderers()));
}

/// A plan with what it feels on.
struct Laboratory {
  explicit Laboratory(const std::string& example, const std::string& observer = "machine")
      : Laboratory(plan_of(example), observer) {}
  Laboratory(Plan felt_plan, const std::string& observer) : plan(std::move(felt_plan)) {
    spec = *psychophysics::parse_observer(observer);
    device = *choose_device({}, session_drivers());
    bench = value_of(Bench::make(plan, {spec.hand, spec.depth_mm, 1000.0}, progress));
    machine = std::make_unique<Machine>(plan, spec, *bench, device);
    const Status learnt = machine->learn(progress);
    EXPECT_TRUE(learnt) << learnt.error().message();
  }
  FeltTrial felt(const std::string& shown, double level) {
    Trial trial;
    trial.shown = shown, trial.level = level;
    return value_of(psychophysics::feel_alone(*bench, device, bench->passes(trial), level, progress));
  }
  std::vector<double> strengths(const std::string& shown, double level) {
    Trial trial;
    trial.shown = shown, trial.level = level;
    FeltTrial felt;
    return value_of(machine->feel(trial, felt, progress));
  }
  ProgressBar progress;
  Plan plan;
  psychophysics::ObserverSpec spec;
  DeviceChoice device;
  std::unique_ptr<Bench> bench;
  std::unique_ptr<Machine> machine;
};

std::size_t ticks_of(const FeltTrial& felt, std::uint32_t interval) {
  return psychophysics::samples_of(felt, interval).size();
}

TEST(FeltTrials, EveryRendererIsSteppedInEveryFrame) {
  Laboratory lab("abx");
  for (const char* shown : {"ABA", "ABB"}) {
    const FeltTrial felt = lab.felt(shown, 0.0);
    EXPECT_GT(felt.frames, 4500u) << "three intervals of 1.5 s";
    EXPECT_EQ(felt.whole_frames, felt.frames);
    EXPECT_EQ(felt.missed_deadlines, 0u) << "on a clock of its own";
    EXPECT_EQ(felt.samples_lost, 0u);
    for (std::uint32_t i = 1; i <= 3; ++i) {
      double most_n = 0.0;
      for (const auto& one : psychophysics::samples_of(felt, i))
        most_n = std::max(most_n, one.force_n.norm());
      EXPECT_GT(most_n, 0.3) << "interval " << i << " of " << shown << " is felt";
    }
    for (const auto& one : felt.samples)
      if (one.interval == 0) {
        EXPECT_EQ(one.force_n.norm(), 0.0) << "between two nothing is";
      }
  }
}

/// What a switch takes says nothing of where it leads: intervals and delays of all orders have the same
/// ticks, to the one by which times are rounded.
TEST(FeltTrials, AShamSwitchTakesTheSameTime) {
  Laboratory lab("abx");
  std::set<std::size_t> ticks, whole;
  for (const char* shown : {"AAA", "ABA", "ABB", "BBA"}) {
    const FeltTrial felt = lab.felt(shown, 0.0);
    for (std::uint32_t i = 1; i <= 3; ++i) ticks.insert(ticks_of(felt, i));
    whole.insert(felt.samples.size());
  }
  EXPECT_LE(*ticks.rbegin() - *ticks.begin(), 1u);
  EXPECT_LE(*whole.rbegin() - *whole.begin(), 3u);
}

TEST(FeltTrials, TheSameTrialIsFeltTheSame) {
  Laboratory lab("constant");
  const FeltTrial a = lab.felt("AB", 0.05), b = lab.felt("AB", 0.05);
  ASSERT_EQ(a.samples.size(), b.samples.size());
  for (std::size_t i = 0; i < a.samples.size(); ++i) {
    ASSERT_EQ(a.samples[i].at_mm, b.samples[i].at_mm) << i;
    ASSERT_EQ(a.samples[i].force_n, b.samples[i].force_n) << i;
  }
}

/// A difference of one Weber fraction is one just noticeable difference, d' 0.954, to 5 %: what the arm's
/// encoder and the hand leave of it. Things that are the same differ by a fiftieth of that.
TEST(MachineObserver, NoticesByTheWeberFractionPutIn) {
  const double d = psychophysics::dprime_at_jnd(psychophysics::Task::kTwoInterval);
  for (const double weber : {0.05, 0.1}) {
    Laboratory lab("constant", "machine:stiffness=" + std::to_string(weber));
    const double level = weber * lab.plan.option->standard;
    const std::vector<double> up = lab.strengths("AB", level), down = lab.strengths("BA", level);
    EXPECT_NEAR(up[1] - up[0], d, 0.05 * d) << weber;
    EXPECT_NEAR(down[0] - down[1], d, 0.05 * d) << weber;
    const std::vector<double> same = lab.strengths("AA", level);
    EXPECT_NEAR(same[1] - same[0], 0.0, 0.02 * d) << weber;
  }
}

/// Four times the spacing, a third of a spacing of noise, 20 Hz.
TEST(MachineObserver, FeelsASpacingANoiseAndARate) {
  const struct {
    const char *key, *renderer;
    double standard, level;
    bool upwards;
  } kTurned[] = {{"spacing", "cloud", 0.5, 1.5, true},
                 {"noise", "cloud", 0.0001, 0.3, true},
                 {"rate", "cloud", 1000.0, 980.0, false}};
  for (const auto& turned : kTurned) {
    SCOPED_TRACE(turned.key);
    Plan plan = plan_of("constant");
    plan.option->renderer = turned.renderer;
    plan.option->key = turned.key;
    plan.option->standard = turned.standard;
    plan.option->upwards = turned.upwards;
    plan.levels = {turned.level};
    plan.catch_level = turned.level;
    const Laboratory lab(plan, "machine:hand=slide");
    const auto& apart = lab.machine->apart();
    double most = 0.0;
    for (const double by : apart) most = std::max(most, std::abs(by));
    std::printf("%s: stiffness %+.2f, force %+.2f, vibration %+.2f, direction %+.2f\n", turned.key, apart[0],
                apart[1], apart[2], apart[3]);
    EXPECT_GT(most, 0.5) << turned.key << " makes no difference";
  }
}

class FeltStudy : public StudyFolder {
 protected:
  /// With keys from standard input; it must end well.
  ProcessOutcome answered(const std::string& plan, const std::string& keys, const std::string& out,
                          const std::string& more = {}) const {
    ProcessOutcome run = person(plan, keys, out, more);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return run;
  }
  /// The same on a virtual clock; however it ends.
  ProcessOutcome person(const std::string& plan, const std::string& keys, const std::string& out,
                        const std::string& more = {}) const {
    return person_in_real_time(plan, keys, out, "--accelerated " + more);
  }
  ProcessOutcome person_in_real_time(const std::string& plan, const std::string& keys, const std::string& out,
                                     const std::string& more = {}) const {
    const std::string line = "printf '" + keys + "' | " PALPATE_PROGRAM " study " + plan +
                             " --observer person --out " + in(out) + " " + more;
    return value_of(run_process({"/bin/sh", "-c", line}, {.time_limit_s = 120.0}));
  }
  /// A short one of the example, of few trials.
  std::string short_plan() const {
    const std::string file = in("short.toml");
    write_text(
        file,
        "task = \"abx\"\nscene = \"sinusoid:points=10201\"\n[compare]\na = \"cloud\"\nb = \"cloud-smooth\"\n"
        "[trials]\ncount = 4\npractice = 1\nbreak_every = 2\ncatch_every = 4\ninterval_s = 1.0\n"
        "[exclusions]\nclipped_frames = 1000000\n");
    return file;
  }
};

TEST_F(FeltStudy, OfAMachineGoesOnWhereItStopped) {
  const std::string plan = short_plan();
  succeeds(study(plan, "machine", "whole"));
  succeeds(study(plan, "machine", "parts", "--stop-after 3"));
  succeeds(study(plan, "machine", "parts"));
  EXPECT_EQ(text_in("parts/trials.csv"), text_in("whole/trials.csv"));
  for (const char* trace : {"trial-0001.csv", "trial-0006.csv"}) {
    const std::string text = text_in(std::string("whole/traces/") + trace);
    EXPECT_TRUE(text.starts_with("t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,interval\n")) << trace;
    EXPECT_EQ(text, text_in(std::string("parts/traces/") + trace));
    EXPECT_THAT(text, Not(HasSubstr("cloud")));
  }
  const auto document = json_in("whole/study.json");
  expect_valid("observed", text_in("whole/study.json"));
  EXPECT_FALSE(document["simulated"].get<bool>());
  EXPECT_EQ(document["traces"], "traces");
}

TEST_F(FeltStudy, APersonAnswersByKeys) {
  const std::string plan = short_plan();
  // Six trials, a break before one of them that waits for the space bar; x answers nothing. In the end a name
  // of a renderer stands nowhere on the screen.
  const ProcessOutcome part = answered(plan, "ax1", "out", "--stop-after 2");
  EXPECT_THAT(part.out, HasSubstr("2 trials are answered")) << part.err;
  EXPECT_THAT(part.err, HasSubstr("trial 2: touch 3 of 3"));
  EXPECT_THAT((part.out + part.err), Not(HasSubstr("cloud"))) << part.out << part.err;
  // Standard input ends early: what was answered stays.
  const ProcessOutcome cut = answered(plan, "b", "out");
  EXPECT_THAT(cut.out, HasSubstr("3 trials are answered")) << cut.err;
  const ProcessOutcome rest = answered(plan, " a b a b", "out");
  EXPECT_THAT(rest.err, HasSubstr("a break"));
  std::istringstream lines(text_in("out/trials.csv"));
  std::string answers;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream cells(line);
    std::string cell;
    for (int i = 0; i < 9; ++i) std::getline(cells, cell, ',');
    answers += cell == "answer" ? "" : cell;
    EXPECT_THAT(line, Not(HasSubstr("cloud")));
  }
  EXPECT_EQ(answers, "001010");
  EXPECT_TRUE(exists("out/traces/trial-0006.csv"));
  expect_valid("observed", text_in("out/study.json"));
}

/// Sleeps in the first tick of each interval, so that the loop misses deadlines.
class Sleeper final : public device::TickObserver {
 public:
  explicit Sleeper(psychophysics::Conductor& conductor) : conductor_(conductor) {}
  void took(const device::Tick&) noexcept override {
    const bool within = conductor_.passage() == psychophysics::Passage::kInterval;
    if (within && !within_) std::this_thread::sleep_for(std::chrono::milliseconds(6));
    within_ = within;
  }

 private:
  psychophysics::Conductor& conductor_;
  bool within_ = false;
};

/// Begins the trial once the hand is calm; ends the session with it.
class OneRealTrial final : public SessionTasks {
 public:
  OneRealTrial(psychophysics::Rig& rig, const psychophysics::Passes& passes) : rig_(rig), passes_(passes) {}
  void work(double now_s) override {
    using psychophysics::Passage;
    psychophysics::Conductor& conductor = rig_.conductor();
    const Passage passage = conductor.passage();
    // Broken: the machine was busy elsewhere.
    if ((passage == Passage::kIdle || passage == Passage::kBroken) && conductor.calm())
      conductor.begin(passes_);
    if (passage == Passage::kDone || now_s > 30.0) rig_.assembly().request_stop();
  }
  void key(char) override {}

 private:
  psychophysics::Rig& rig_;
  psychophysics::Passes passes_;
};

TEST(FeltTrials, DeadlinesThatTheRealLoopMissedAreCountedAndExcludeATrial) {
  Plan plan = plan_of("abx");
  plan.interval_s = 0.5;
  plan.switch_delay_s = 0.05;
  ProgressBar progress;
  auto bench = value_of(Bench::make(plan, {"press", 4.0, 1000.0}, progress));
  SessionClock clock(false);
  auto device = value_of(SessionDevice::make(*choose_device({}, session_drivers()), clock.clock(), 1e-3));
  auto rig = value_of(psychophysics::Rig::make(*bench, clock, device, 0.0, progress));
  Sleeper sleeper(rig->conductor());
  rig->assembly().observe(sleeper);
  Trial trial;
  trial.shown = "AB";
  OneRealTrial tasks(*rig, bench->passes(trial));
  const auto end = value_of(rig->run(tasks, progress));
  ASSERT_EQ(rig->conductor().passage(), psychophysics::Passage::kDone);
  const FeltTrial felt = rig->conductor().take();
  EXPECT_GE(felt.missed_deadlines, 8u) << "twice 6 ms at 1 kHz";
  EXPECT_LE(felt.missed_deadlines, end.loop.missed) << "the loop's own count";
  EXPECT_GT(ticks_of(felt, 1), 100u);
  psychophysics::Answer answer;
  answer.seconds = 1.0;
  answer.missed_deadlines = felt.missed_deadlines;
  EXPECT_EQ(psychophysics::exclusion_of(answer, plan.exclusions), "missed deadline");
  answer.missed_deadlines = 0;
  EXPECT_EQ(psychophysics::exclusion_of(answer, plan.exclusions), "");
}

TEST_F(FeltStudy, OfAPersonInRealTimeKeepsHowTheLoopWasScheduled) {
  const std::string file = in("real.toml");
  write_text(
      file,
      "task = \"yes-no\"\nscene = \"sinusoid:points=2601\"\n[compare]\na = \"cloud\"\nb = \"cloud-smooth\"\n"
      "[trials]\ncount = 4\npractice = 0\ncatch_every = 0\nswitch_delay_s = 0.05\ninterval_s = 0.5\n"
      "[exclusions]\nmissed_deadlines = 1000000\nclipped_frames = 1000000\nfastest_s = 0\n");
  const Stopwatch watch;
  const ProcessOutcome part = person_in_real_time(file, "12", "out", "--stop-after 2");
  ASSERT_EQ(part.exit_code, 0) << part.err;
  const ProcessOutcome rest = person_in_real_time(file, "21", "out");
  ASSERT_EQ(rest.exit_code, 0) << rest.err;
  EXPECT_GT(watch.ms(), 4.0 * 550.0) << "four intervals and delays take their time";
  const std::string text = text_in("out/study.json");
  expect_valid("observed", text);
  const auto document = nlohmann::json::parse(text);
  EXPECT_EQ(document["trials"]["rows"], 4);
  ASSERT_EQ(document["sessions"].size(), 2u);
  for (const auto& session : document["sessions"]) {
    EXPECT_TRUE(session["real_time"].get<bool>());
    EXPECT_THAT(session["scheduling"].get<std::string>(), HasSubstr("SCHED_")) << session;
    EXPECT_EQ(session["rate_hz"], 1000.0);
    EXPECT_GT(session["ticks"].get<int>() + session["missed"].get<int>(), 1000) << session;
    EXPECT_GT(session["trial_frames"].get<int>(), 400) << session;
    EXPECT_LE(session["whole_frames"].get<int>(), session["trial_frames"].get<int>());
    EXPECT_GT(2 * session["whole_frames"].get<int>(), session["trial_frames"].get<int>()) << session;
    EXPECT_GE(session["late_us"]["max"].get<double>(), session["late_us"]["p50"].get<double>());
  }
  EXPECT_EQ(document["sessions"][0]["last_trial"], 2);
  EXPECT_EQ(document["sessions"][1]["first_trial"], 3);
  EXPECT_THAT(text_in("out/report.html"), HasSubstr("Sessions at the device"));
  // A trace has a row for every tick, in order.
  std::istringstream trace(text_in("out/traces/trial-0003.csv"));
  std::string line;
  std::getline(trace, line);
  double before_s = -1.0, first_s = 0.0;
  int ticks = 0, touching = 0;
  for (; std::getline(trace, line); ++ticks) {
    const double t_s = std::stod(line);
    if (ticks == 0) first_s = t_s;
    EXPECT_GT(t_s, before_s);
    before_s = t_s;
    touching += line.ends_with(",1,1") ? 1 : 0;
  }
  EXPECT_GT(before_s - first_s, 0.5);
  EXPECT_GT(touching, 50) << "the interval was felt";
  // A line of it that somebody changed is named.
  write_text(in("out/sessions.jsonl"), "{\"started_utc\": 3}\n");
  const ProcessOutcome changed = person_in_real_time(file, "", "out");
  EXPECT_EQ(changed.exit_code, 2);
  EXPECT_THAT(changed.err, HasSubstr("sessions.jsonl:1"));
}

TEST_F(FeltStudy, ALevelIsFeltAfterAnother) {
  // The staircase makes a renderer anew for each level, in one session.
  EXPECT_THAT(answered("staircase", "11221122", "out", "--stop-after 8").out,
              HasSubstr("8 trials are answered"));
}

TEST_F(FeltStudy, MarksGoToLabStreamingLayer) {
  const Environment file("LSL_STUB_FILE", in("marks").c_str());
  const std::string plan = short_plan();
  answered(plan, "1", "out", "--stop-after 1 --lsl --lsl-library " PALPATE_LSL_STUB);
  const std::string marks = text_in("marks");
  std::size_t at = 0;
  for (const char* next : {"name;Palpate;1", "type;Markers;0", "source;palpate-P01;3", "outlet;chunk;0",
                           "outlet;buffered;360", "sample;trial 1 begins;", "sample;trial 1 interval 1;",
                           "sample;trial 1 interval 2;", "sample;trial 1 interval 3;", "sample;trial 1 ends;",
                           "sample;trial 1 answer 1;", "end;outlet", "end;info"}) {
    at = marks.find(next, at);
    ASSERT_NE(at, std::string::npos) << next << "\n" << marks;
  }
  const ProcessOutcome none = person(plan, "1", "none", "--lsl --lsl-library " + in("liblsl.so"));
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.err, HasSubstr("--lsl-library"));
  EXPECT_FALSE(exists("none"));
}

TEST_F(FeltStudy, WhatDoesNotGoTogetherIsRefused) {
  refuses({}, study("abx", "simulated:dprime=1", "out", "--accelerated"));
  refuses({}, study("abx", "machine", "out", "--lsl"));
  refuses({}, study("abx", "machine", "out", "--device nothing"));
  refuses({}, study("abx", "machine:hand=tap", "out"));
  refuses({}, study("abx", "machine", "out", "--rate 1000.5"));
  // What a plan asks for, and no renderer can, is said before anything is written.
  const std::string file = in("rate.toml");
  write_text(
      file,
      "task = \"2ifc\"\nscene = \"sinusoid:points=961\"\n[option]\nrenderer = \"cloud\"\nkey = \"rate\"\n"
      "unit = \"Hz\"\nstandard = 1000.0\n[trials]\ncount = 4\nlevels = [500.0]\n");
  EXPECT_THAT(refuses({}, study(file, "machine", "out")).err, HasAll("rate.toml", "1000 Hz"));
  EXPECT_FALSE(exists("out"));
  EXPECT_EQ(psychophysics::choice_of(psychophysics::Task::kAbx, 's'), -1);
  EXPECT_EQ(psychophysics::choice_of(psychophysics::Task::kSameDifferent, 'd'), 1);
}

}  // namespace
}  // namespace palpate::experiments

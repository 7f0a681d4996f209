#include "experiments/command/common_options.h"
#include "experiments/command/device_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/psychophysics/blinded.h"

namespace palpate::experiments {
namespace {

void declare_study(const Declaration& declare, psychophysics::BlindedArguments& a) {
  constexpr NumberRange kTrials{1, psychophysics::kMostTrials}, kRate{500.0, 8'000.0};
  declare.required(
      "PLAN", a.plan,
      "a plan (.toml), or an example by its name: abx, same-different, constant, staircase, psi");
  declare.text(
      "--observer", a.observer,
      "who answers: simulated:dprime=1, or simulated:jnd=0.05 where an option is turned (strategy, "
      "slope, lapse, bias, criterion, catch_dprime, missed); machine: a simulated hand and thresholds "
      "of the literature (hand=press, slide or explore, depth, stiffness, force, direction, vibration, "
      "moved, lapse, bias, criterion, strategy); person: keys, on the device (hand and depth of a "
      "simulated one) (default: simulated:dprime=1)");
  declare_device(declare, a.device);
  declare.text("--grip", a.device.grip,
               "how a simulated hand holds a simulated device: hand, finger or arm (default: hand)");
  declare.number("--rate", a.rate_hz, kRate, "of the servo, whole Hz (default: 1000)");
  declare.flag(
      "--accelerated", a.accelerated,
      "of a person's session on a simulated device: as fast as it goes, answers from standard input");
  declare.flag(
      "--lsl", a.lsl,
      "of a person's session: mark trials, intervals and answers in a stream of Lab Streaming Layer");
  declare.text("--lsl-library", a.lsl_library, "its library (default: liblsl.so.2, as the system finds it)");
  declare.text("--participant", a.participant,
               "code of the participant, a folder each (default: the plan's)");
  declare.integer("--stop-after", a.stop_after, kTrials,
                  "end this session after so many trials; the same command goes on from there");
  declare.flag("--power", a.power, "print trials for the wanted power and the equivalence bound, and stop");
  declare.text("--save-plan", a.save_plan, "write the plan to this new file, to be changed, and stop");
  declare.text("--out", a.out, "folder for the results (default: out/study-NAME)");
  declare.flag("--json", a.json, "print study.json instead of tables");
}

}  // namespace

Subcommand study_subcommand() {
  return subcommand(
      "study",
      "a blinded study by a plan: ABX, same-different, forced choice, staircases; with a simulated "
      "observer, a machine that feels, or a person",
      {"palpate study abx --observer simulated:dprime=2 --out out/abx",
       "palpate study staircase --observer simulated:jnd=0.05 --out out/staircase",
       "palpate study staircase --observer machine --out out/predicted",
       "palpate study my-study.toml --observer person --device falcon --participant P02",
       "palpate study abx --power"},
      declare_study, psychophysics::run_blinded);
}

}  // namespace palpate::experiments

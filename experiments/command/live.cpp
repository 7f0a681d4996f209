// Renderers under a hand, and blinded studies of them.
#include "experiments/live/live.h"
#include "experiments/bridge/serve.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_session.h"
#include "experiments/psychophysics/blinded.h"

namespace palpate::experiments {
namespace {

void declare_live(const Declaration& declare, LiveArguments& a) {
  constexpr NumberRange kSeconds{0.1, 86'400.0}, kEvery{0.0, 86'400.0}, kFade{1.0, 1'000.0},
      kStandIn{0.0, 1e7};
  RunArguments& run = a.run;
  declare_scene_or_stream(declare, run);
  declare_renderers(declare, run.renderers,
                    "the scene's or the plan's, cloud, and a mesh; at most 7, the "
                    "first is felt first");
  declare_device(declare, a.device);
  declare.text(
      "--hand", a.hand,
      "what the simulated hand does: explore by what it feels, follow the path, press, slide or tap; "
      "mouse: goes where the mouse says (default: explore; follow where --path names another than "
      "hand; with --window mouse)");
  declare.number("--seconds", a.seconds, kSeconds,
                 "how long (default: 10; with --window until it is closed)");
  declare.number("--switch-every", a.switch_every_s, kEvery,
                 "seconds between switches to the next renderer (default: 0, never)");
  declare.rare().text(
      "--rule", a.rule,
      "of a switch that free space does not allow at once: wait (a fade in contact, else wait for free "
      "space), refuse (a fade in contact, else refuse) or free (wait for free space) (default: wait)");
  declare.rare().number("--fade", a.fade_ms, kFade,
                        "length of a fade in contact, ms; 100 to 200 (default: 150)");
  declare.rare().text(
      "--changes", a.changes,
      "SECONDS:LABEL:key=value[:key=value..],..: a renderer's options change while it is felt; "
      "stiffness (N/mm) and force_limit (N) too");
  declare.rare().text(
      "--mapping", a.mapping,
      "of the workspace: 1:1, fitted, or mm of the scene for a mm of the device (default: 1:1)");
  declare_rate(declare.rare(), a.rate_hz);
  declare.flag("--accelerated", a.accelerated,
               "as fast as it goes, on a clock of its own: the same session every time");
  declare.flag(
      "--window", a.window,
      "a window over the session: the cloud, what is felt, plots, switches by buttons; without a device "
      "the mouse is the hand. A scan that is dropped on it is opened");
  declare.rare().text(
      "--up", a.up,
      "what is up in the window: z, y (most scans of objects), x, -z, -y or -x; key u turns it on "
      "(default: as the scene's [view] has it, else z)");
  declare.rare().number(
      "--stand-in", a.stand_in, kStandIn,
      "points of the coarse cloud that is felt in a window until the renderers of a larger scene are "
      "prepared; 0: none (default: 60000)");
  declare.text("--listen", a.listen,
               "PORT or ADDRESS:PORT: hears OSC and lines of JSON over UDP that switch, select, cancel, mark "
               "and re-arm; 0 finds a port");
  declare.rare().flag("--rearm", a.rearm, "arm again a second after a fault (simulated devices alone)");
  declare.text("--record", a.record, "FILE.palrec: a recording of the session, every renderer of it");
  declare_path(declare, run.path, "by the model's size");
  declare_force(declare, a.replace);
  declare_scene_run(declare, run);
}

void declare_record(const Declaration& declare, RecordArguments& a) {
  constexpr NumberRange kSeconds{0.0, 86'400.0, true};
  declare.required("SCENE", a.scene, kSceneHelp);
  declare_renderer(declare, a.renderer);
  declare_device(declare, a.device);
  declare_path(declare, a.path, "by the model's size, as long as the session");
  declare.number("--seconds", a.seconds, kSeconds, "length of the session (default: 10)");
  declare_rate(declare, a.rate_hz);
  declare.required("--out", a.out, "the recording, FILE.palrec");
  declare.rare().choice(
      "--flush", a.flush, {"disk", "system"},
      "how far each chunk of a quarter of a second goes before the next: disk survives a loss of "
      "power, system the end of the program alone (default: disk)");
  declare.flag("--accelerated", a.accelerated,
               "on a virtual clock, as fast as it goes: the same session every time");
  declare_force(declare, a.force);
  declare_json(declare, a.json);
  declare_surface(declare, a.surface);
  declare_model(declare, a.load);
}

void declare_serve(const Declaration& declare, BridgeArguments& a) {
  constexpr NumberRange kSeconds{0.0, 86'400.0}, kTimes{1.0, 1000.0}, kForces{0.0, 100.0};
  declare_device(declare, a.device);
  declare.text("--listen", a.listen,
               "ADDRESS:PORT of this machine; 0.0.0.0 for all of its networks, port 0 for any (default: "
               "127.0.0.1:47800, this machine alone)");
  declare.number("--seconds", a.seconds, kSeconds, "how long (default: 0, until it is stopped)");
  declare_rate(declare, a.rate_hz);
  declare.rare().number("--watchdog-ms", a.watchdog_ms, kTimes,
                        "without a command for longer: zero force (default: 20)");
  declare.rare().number("--most-age-ms", a.most_age_ms, kTimes,
                        "a command that answers a state of longer ago is refused (default: 20)");
  declare.number("--force-limit", a.force_limit_n, kForces,
                 "N, whatever is commanded (default: 0, the device's own limit)");
  declare_json(declare, a.json);
}

Result<int> run_serve(const BridgeArguments& arguments, Context& context) {
  return run_bridge(arguments, context);
}

void declare_study(const Declaration& declare, psychophysics::BlindedArguments& a) {
  constexpr NumberRange kTrials{1, psychophysics::kMostTrials};
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
  declare_rate(declare.rare(), a.rate_hz);
  declare.flag(
      "--accelerated", a.accelerated,
      "of a person's session on a simulated device: as fast as it goes, answers from standard input");
  declare.rare().flag(
      "--lsl", a.lsl,
      "of a person's session: mark trials, intervals and answers in a stream of Lab Streaming Layer");
  declare.rare().text("--lsl-library", a.lsl_library,
                      "its library (default: liblsl.so.2, as the system finds it)");
  declare.text("--participant", a.participant,
               "code of the participant, a folder each (default: the plan's)");
  declare.integer("--stop-after", a.stop_after, kTrials,
                  "end this session after so many trials; the same command goes on from there");
  declare.flag("--power", a.power, "print trials for the wanted power and the equivalence bound, and stop");
  declare.text("--save-plan", a.save_plan, "write the plan to this new file, to be changed, and stop");
  declare.text("--out", a.out, "folder for the results (default: out/study-NAME)");
  declare_json(declare, a.json);
  declare.verbose();
}

}  // namespace

Subcommand live_subcommand() {
  return subcommand(
      "live", "renderers under one hand on a device, simulated or real, switched while they are felt",
      {"palpate live sinusoid:points=10201 --renderers cloud,mesh-godobject --seconds 10 --switch-every 1 "
       "--out "
       "out/live",
       "palpate live sinusoid:points=10201 --renderers cloud,cloud-smooth --device sim:falcon --hand slide "
       "--seconds 60 --switch-every 0.7 --accelerated --out out/slide",
       "palpate live scan.ply --window --up y",
       "palpate live sinusoid:points=10201 --renderers cloud --changes "
       "2:cloud:stiffness=0.8,4:cloud:refine=1 "
       "--seconds 6 --accelerated --out out/changes",
       "palpate live scan.ply --unit m --renderers cloud,cloud-smooth --device falcon --guard-kill-after 50 "
       "--listen 7700"},
      declare_live, run_live);
}

Subcommand record_subcommand() {
  return subcommand(
      "live record", "one renderer under a hand on a device, every tick recorded",
      {"palpate live record sinusoid:points=10201 --renderer cloud --seconds 10 --out session.palrec",
       "palpate live record scan.ply --unit m --device sim:falcon --renderer cloud-smooth --seconds 5 "
       "--accelerated --out falcon.palrec",
       "palpate compare sinusoid:points=10201 --renderers auto --path session.palrec --out out/again"},
      declare_record, run_record);
}

Subcommand serve_subcommand() {
  return subcommand(
      "live serve", "serves a device of this machine to programs at another one, over UDP",
      {"palpate live serve --device sim:omni --seconds 1",
       "palpate live serve --device sim:falcon --listen 127.0.0.1:0 --force-limit 2 --seconds 1 --json"},
      declare_serve, run_serve);
}

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
